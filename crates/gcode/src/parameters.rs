//! Control parameters that decide how a program is read, by their numbers on a Fanuc 16i.

use std::collections::BTreeMap;

/// Parameters by number. A bit of a parameter is set and read as `6001.5`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parameters(BTreeMap<u32, f64>);

impl Parameters {
    /// Takes `6050` or `6001.5` with its value.
    ///
    /// # Errors
    /// The key is neither a number nor number and bit, or the value of a bit is not 0 or 1.
    pub fn set(&mut self, key: &str, value: f64) -> Result<(), String> {
        let wrong =
            || format!("parameter \"{key}\": a number such as \"6050\", or number and bit such as \"6001.5\", was expected");
        let (number, bit) = match key.split_once('.') {
            Some((number, bit)) => (number, Some(bit)),
            None => (key, None),
        };
        let number: u32 = number.trim().parse().map_err(|_| wrong())?;
        let Some(bit) = bit else {
            self.0.insert(number, value);
            return Ok(());
        };
        let bit: u8 = bit.trim().parse().map_err(|_| wrong())?;
        if bit > 7 || (value != 0.0 && value != 1.0) {
            return Err(format!("parameter \"{key}\" = {value}: bits are 0 to 7 and hold 0 or 1"));
        }
        let old = self.bits(number);
        let mask = 1_u8 << bit;
        let new = if value == 1.0 { old | mask } else { old & !mask };
        self.0.insert(number, f64::from(new));
        // A bit that was said to be 0 differs from one that nobody spoke of.
        self.0.insert(SAID + number * 8 + u32::from(bit), value);
        Ok(())
    }

    /// A parameter's value; 0 when nobody set it.
    pub fn value(&self, number: u32) -> f64 {
        self.0.get(&number).copied().unwrap_or(0.0)
    }

    /// A bit of a parameter, when somebody set it.
    pub fn bit(&self, number: u32, bit: u8) -> Option<bool> {
        match self.0.get(&(SAID + number * 8 + u32::from(bit))) {
            Some(value) => Some(*value == 1.0),
            None => self.0.get(&number).map(|_| self.bits(number) >> bit & 1 == 1),
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
        assert!(p.set("6001.9", 1.0).is_err());
        assert!(p.set("TCS", 1.0).is_err());
        assert!(p.set("6001.5", 7.0).is_err());
    }
}
