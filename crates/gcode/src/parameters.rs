//! Control parameters that decide how a program is read, by their numbers on a Fanuc 16i.

use std::collections::BTreeMap;

/// Parameters by number. A bit of a parameter is set and read as `6001.5`, one that each axis has as `1241/X`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parameters {
    values: BTreeMap<u32, f64>,
    /// By number and axis, 0 to 2.
    of_axes: BTreeMap<(u32, usize), f64>,
}

impl Parameters {
    /// Takes `6050`, `6001.5` or `1241/X` with its value.
    ///
    /// # Errors
    /// The key is neither a number nor number and bit, or the value of a bit is not 0 or 1.
    pub fn set(&mut self, key: &str, value: f64) -> Result<(), String> {
        let wrong = || {
            format!(
                "parameter \"{key}\": a number such as \"6050\", number and bit such as \"6001.5\", or number and axis such as \"1241/X\", was expected"
            )
        };
        if !value.is_finite() {
            return Err(format!("parameter \"{key}\" = {value}: a finite number was expected"));
        }
        if let Some((number, axis)) = key.split_once('/') {
            let number: u32 = number.trim().parse().map_err(|_| wrong())?;
            let axis = match axis.trim() {
                "X" | "x" => 0,
                "Y" | "y" => 1,
                "Z" | "z" => 2,
                _ => return Err(wrong()),
            };
            self.of_axes.insert((number, axis), value);
            return Ok(());
        }
        let (number, bit) = match key.split_once('.') {
            Some((number, bit)) => (number, Some(bit)),
            None => (key, None),
        };
        let number: u32 = number.trim().parse().map_err(|_| wrong())?;
        let Some(bit) = bit else {
            self.values.insert(number, value);
            return Ok(());
        };
        let bit: u8 = bit.trim().parse().map_err(|_| wrong())?;
        if bit > 7 || (value != 0.0 && value != 1.0) {
            return Err(format!("parameter \"{key}\" = {value}: bits are 0 to 7 and hold 0 or 1"));
        }
        let old = self.bits(number);
        let mask = 1_u8 << bit;
        let new = if value == 1.0 { old | mask } else { old & !mask };
        self.values.insert(number, f64::from(new));
        // A bit that was said to be 0 differs from one that nobody spoke of.
        self.values.insert(SAID + number * 8 + u32::from(bit), value);
        Ok(())
    }

    /// An axis's value of a parameter that each axis has.
    pub fn of_axis(&self, number: u32, axis: usize) -> Option<f64> {
        self.of_axes.get(&(number, axis)).copied()
    }

    /// A parameter's value; 0 when nobody set it.
    pub fn value(&self, number: u32) -> f64 {
        self.values.get(&number).copied().unwrap_or(0.0)
    }

    /// A bit of a parameter, when somebody set it.
    pub fn bit(&self, number: u32, bit: u8) -> Option<bool> {
        match self.values.get(&(SAID + number * 8 + u32::from(bit))) {
            Some(value) => Some(*value == 1.0),
            None => self.values.get(&number).map(|_| self.bits(number) >> bit & 1 == 1),
        }
    }

    fn is(&self, number: u32, bit: u8) -> bool {
        self.bit(number, bit).unwrap_or(false)
    }

    fn bits(&self, number: u32) -> u8 {
        self.value(number) as i64 as u8
    }
}

/// Where single bits that were said are remembered, far above all parameters.
const SAID: u32 = 1 << 24;

/// What calls a program that is not its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CodeCall {
    /// The code's number.
    pub code: u16,
    /// O number of the program.
    pub program: u32,
    /// 6050-6059 with a negative value: the call stays in force as by G66.
    pub modal: bool,
}

/// What parameters say, ready for use.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Settings {
    pub all: Parameters,
    /// 6050-6059: G codes that call O9010-O9019.
    pub g_calls: Vec<CodeCall>,
    /// 6071-6079: M codes that call O9001-O9009 as subprograms.
    pub m_subprograms: Vec<CodeCall>,
    /// 6080-6089: M codes that call O9020-O9029.
    pub m_calls: Vec<CodeCall>,
    /// 6001.5 TCS: T calls O9000.
    pub t_calls: bool,
    /// 6007.1 SCS: S calls O9029.
    pub s_calls: bool,
    /// 6007.2 BCS: the second auxiliary code B calls O9028.
    pub b_calls: bool,
    /// 6001.1 PRT: leading zeros of a printed number print nothing instead of blanks.
    pub prints_no_zeros: bool,
    /// 6001.4 CRO: printed lines end in CR LF.
    pub prints_returns: bool,
    /// 6008.7 IJK: arguments are always of the first kind.
    pub first_arguments: bool,
    /// 6000.3 V15: tool offset variables as on a series 15.
    pub series_15: bool,
    /// 5013: largest wear entry; 0 is no limit of its own. In least increments or lengths, as the profile says.
    pub largest_wear: f64,
    /// 5014: largest change of a wear entry that is entered incrementally.
    pub largest_wear_step: f64,
    /// 6003.7 MUS: interruption macros.
    pub interruptions: bool,
    /// M96 and M97, or what 6033 and 6034 say with 6003.6 MPR.
    pub interruption_codes: [u16; 2],
    /// 6003.3 TSE: the signal interrupts as long as it is on; else when it comes on.
    pub interrupts_by_state: bool,
    /// 6003.4 MIN: the macro runs behind the block; else at once.
    pub interrupts_behind_block: bool,
    /// 6003.5 MSB: the macro shares the locals of the program; else it has its own.
    pub interruption_shares_locals: bool,
    /// 5004.1 ORC: X offsets of a lathe are radius values.
    pub radius_offsets: bool,
}

impl Settings {
    pub(crate) fn of(parameters: &Parameters) -> Self {
        let calls = |first: u32, count: u32, program: u32| {
            (0..count)
                .filter_map(|k| {
                    let value = parameters.value(first + k);
                    let code = value.abs();
                    (1.0..=9999.0).contains(&code).then_some(CodeCall {
                        code: code as u16,
                        program: program + k,
                        modal: value < 0.0,
                    })
                })
                .collect()
        };
        Settings {
            g_calls: calls(6050, 10, 9010),
            m_subprograms: calls(6071, 9, 9001),
            m_calls: calls(6080, 10, 9020),
            t_calls: parameters.is(6001, 5),
            s_calls: parameters.is(6007, 1),
            b_calls: parameters.is(6007, 2),
            prints_no_zeros: parameters.is(6001, 1),
            prints_returns: parameters.is(6001, 4),
            first_arguments: parameters.is(6008, 7),
            series_15: parameters.is(6000, 3),
            largest_wear: parameters.value(5013),
            largest_wear_step: parameters.value(5014),
            interruptions: parameters.is(6003, 7),
            interruption_codes: match parameters.is(6003, 6) {
                true => [6033, 6034].map(|n| parameters.value(n).clamp(0.0, 9999.0) as u16),
                false => [96, 97],
            },
            interrupts_by_state: parameters.is(6003, 3),
            interrupts_behind_block: parameters.is(6003, 4),
            interruption_shares_locals: parameters.is(6003, 5),
            radius_offsets: parameters.is(5004, 1),
            all: parameters.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_and_numbers_are_set_and_wrong_keys_are_named() {
        let mut p = Parameters::default();
        p.set("6001.5", 1.0).unwrap();
        p.set("6001.1", 0.0).unwrap();
        p.set("6050", -100.0).unwrap();
        assert_eq!(
            (p.bit(6001, 5), p.bit(6001, 1), p.bit(6004, 0)),
            (Some(true), Some(false), None)
        );
        assert_eq!(p.value(6001), 32.0);
        let s = Settings::of(&p);
        assert!(s.t_calls && s.g_calls[0].modal && s.g_calls[0].program == 9010);
        p.set("1241/X", -50.5).unwrap();
        assert_eq!((p.of_axis(1241, 0), p.of_axis(1241, 1)), (Some(-50.5), None));
        assert!(p.set("1241/Q", 1.0).is_err());
        assert!(p.set("6001.9", 1.0).is_err());
        assert!(p.set("TCS", 1.0).is_err());
        assert!(p.set("6001.5", 7.0).is_err());
    }
}
