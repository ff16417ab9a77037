//! What a machine is made of, key by key: loops, drives, references, spindle and cut. What a file leaves out is as in the built-in machine of
//! its kind.
//!
//! One table, [`KEYS`], is the key with its unit, what it may be, and where it goes; reading, refusing, showing and the examples in
//! `store/machines/` go by it.

use super::{MachineFile, MachineKind, Refusal};
use machine::{AxisParameters, MachineParameters, PositionLaw};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use toml::Spanned;
use units::{Axis, Millimetres, MmPerSec};

/// What a number may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum May {
    Any,
    Positive,
    NotNegative,
    /// 0 to 1.
    Part,
    /// A whole number, 0 or more.
    Count,
}

impl May {
    fn be(self, number: f64) -> Result<(), &'static str> {
        let (is, needed) = match self {
            May::Any => (true, "a finite number is needed"),
            May::Positive => (number > 0.0, "a finite number above 0 is needed"),
            May::NotNegative => (number >= 0.0, "a finite number, 0 or more, is needed"),
            May::Part => ((0.0..=1.0).contains(&number), "0 to 1 is needed"),
            May::Count => (
                number >= 0.0 && number.fract() == 0.0 && number <= MOST_COUNTS,
                "a whole number, 0 to 10000000, is needed",
            ),
        };
        if is && number.is_finite() { Ok(()) } else { Err(needed) }
    }
}

const MOST_COUNTS: f64 = 1e7;

/// A number of a machine.
struct Key {
    table: &'static str,
    name: &'static str,
    may: May,
    of: fn(&mut MachineParameters) -> &mut f64,
}

/// A number of an axis.
struct AxisKey {
    table: &'static str,
    name: &'static str,
    may: May,
    of: fn(&mut AxisParameters) -> &mut f64,
}

macro_rules! keys {
    ($type:ident: $($table:literal $name:literal $may:ident $of:expr;)*) => {
        &[$($type { table: $table, name: $name, may: May::$may, of: $of }),*]
    };
}

/// Numbers of the whole machine.
const KEYS: &[Key] = keys! { Key:
    "loop" "following_warning_mm" Positive |m| &mut m.following_warning.0;
    "loop" "following_fault_mm" Positive |m| &mut m.following_fault.0;
    "loop" "in_position_mm" Positive |m| &mut m.in_position.0;
    "loop" "in_position_time_out_s" NotNegative |m| &mut m.in_position_time_out.0;
    "loop" "slow_jog_mm_s" Positive |m| &mut m.slow_jog.0;
    "spindle.drive" "inertia_kg_m2" Positive |m| &mut m.spindle.inertia;
    "spindle.drive" "torque_nm" Positive |m| &mut m.spindle.torque;
    "spindle.drive" "power_w" Positive |m| &mut m.spindle.power;
    "spindle.drive" "friction_nm" NotNegative |m| &mut m.spindle.friction;
    "spindle.drive" "viscous_nm_s_rad" NotNegative |m| &mut m.spindle.viscous;
    "spindle.drive" "tolerance_part" Part |m| &mut m.spindle.tolerance;
    "spindle.drive" "time_out_s" Positive |m| &mut m.spindle.time_out.0;
    "spindle.drive" "encoder_counts_per_turn" Count |m| &mut m.spindle.encoder_counts;
    "spindle.drive" "response_s" Positive |m| &mut m.spindle.response.0;
    "spindle.drive" "reversal_rad_s2" Positive |m| &mut m.spindle.reversal;
    "cutting" "force_n_s_mm" NotNegative |m| &mut m.cutting.force_per_speed;
    "cutting" "highest_force_n" NotNegative |m| &mut m.cutting.highest_force;
    "cutting" "fastest_feed_mm_s" NotNegative |m| &mut m.cutting.fastest_feed.0;
    "cutting" "arm_m" NotNegative |m| &mut m.cutting.arm;
};

/// Numbers of each axis.
const AXIS_KEYS: &[AxisKey] = keys! { AxisKey:
    "homing" "search_mm_s" Positive |m| &mut m.homing.search.0;
    "homing" "slow_search_mm_s" Positive |m| &mut m.homing.slow_search.0;
    "homing" "reference_mm" Any |m| &mut m.homing.reference.0;
    "homing" "home_mm" Any |m| &mut m.homing.home.0;
    "homing" "switch_before_mm" Positive |m| &mut m.homing.switch_before.0;
    "homing" "time_out_s" Positive |m| &mut m.homing.time_out.0;
    "servo" "position_rad_s_mm" NotNegative |m| &mut m.servo.position;
    "servo" "velocity_v_s_rad" Positive |m| &mut m.servo.velocity;
    "servo" "integral_time_s" Positive |m| &mut m.servo.integral_time;
    "servo" "friction_compensation_part" Part |m| &mut m.servo.friction_compensation;
    "servo" "breakaway_travel_mm" Positive |m| &mut m.servo.breakaway_travel;
    "mechanics" "current_gain_a_v" Positive |m| &mut m.mechanics.current_gain;
    "mechanics" "torque_constant_nm_a" Positive |m| &mut m.mechanics.torque_constant;
    "mechanics" "transmission_mm_rad" Positive |m| &mut m.mechanics.transmission;
    "mechanics" "inertia_kg_m2" Positive |m| &mut m.mechanics.inertia;
    "mechanics" "viscous_nm_s_rad" NotNegative |m| &mut m.mechanics.viscous;
    "mechanics" "static_friction_plus_v" NotNegative |m| &mut m.mechanics.static_friction[0];
    "mechanics" "static_friction_minus_v" NotNegative |m| &mut m.mechanics.static_friction[1];
    "mechanics" "coulomb_friction_plus_v" NotNegative |m| &mut m.mechanics.coulomb_friction[0];
    "mechanics" "coulomb_friction_minus_v" NotNegative |m| &mut m.mechanics.coulomb_friction[1];
    "mechanics" "stribeck_speed_rad_s" Positive |m| &mut m.mechanics.stribeck_speed;
    "mechanics" "rated_current_a" Positive |m| &mut m.mechanics.rated_current;
    "mechanics" "peak_current_a" Positive |m| &mut m.mechanics.peak_current;
    "mechanics" "motor_pulses_per_turn" Positive |m| &mut m.mechanics.motor_pulses;
    "mechanics" "backlash_mm" NotNegative |m| &mut m.mechanics.backlash;
    "mechanics" "expansion_mm_k" NotNegative |m| &mut m.mechanics.expansion;
    "mechanics" "heating_k_j" NotNegative |m| &mut m.mechanics.heating;
    "mechanics" "cooling_time_s" Positive |m| &mut m.mechanics.cooling_time;
};

/// What a file says of its machine beyond travels and limits; what it leaves out is as built in.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// By place in the table of keys.
    numbers: BTreeMap<usize, f64>,
    /// By axis and place in the table of an axis's keys.
    of_axes: BTreeMap<(usize, usize), f64>,
    absolute_encoders: Option<bool>,
    position_law: Option<PositionLaw>,
    tool_change_stops_spindle: Option<bool>,
    tool_change_at: Option<[f64; 3]>,
}

/// The words of `loop.position_law`.
const LAWS: [(&str, PositionLaw); 2] = [
    ("feed-forward", PositionLaw::FeedForward),
    ("speed-set-point", PositionLaw::SpeedSetPoint),
];

/// A value before its key says what it may be.
#[derive(Deserialize)]
#[serde(untagged)]
pub(super) enum Given {
    Flag(bool),
    Number(f64),
    Word(String),
}

/// A table of values by name.
pub(super) type Values = BTreeMap<Spanned<String>, Spanned<Given>>;

/// The tables of an axis.
#[derive(Default)]
pub(super) struct AxisTables {
    pub homing: Values,
    pub servo: Values,
    pub mechanics: Values,
}

/// The tables of the machine.
pub(super) struct Tables {
    pub of_loop: Values,
    pub spindle_drive: Values,
    pub cutting: Values,
    pub tool_changer: Values,
    pub axes: [AxisTables; 3],
}

/// A card with registers instead of the simulator.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CardText {
    pub registers: PathBuf,
}

impl Model {
    /// Takes what the tables say.
    pub(super) fn read(tables: Tables) -> Result<Model, Refusal> {
        let mut model = Model::default();
        for (name, value) in tables.of_loop {
            let at = value.span().start;
            match (name.get_ref().as_str(), value.into_inner()) {
                ("absolute_encoders", value) => model.absolute_encoders = Some(flag(at, value)?),
                ("position_law", value) => model.position_law = Some(law(at, value)?),
                (_, value) => model.number("loop", &["absolute_encoders", "position_law"], name, at, value)?,
            }
        }
        for (table, values) in [("spindle.drive", tables.spindle_drive), ("cutting", tables.cutting)] {
            for (name, value) in values {
                let at = value.span().start;
                model.number(table, &[], name, at, value.into_inner())?;
            }
        }
        let mut place: [Option<(usize, f64)>; 3] = [None; 3];
        let mut table_at = 0;
        for (name, value) in tables.tool_changer {
            let at = value.span().start;
            table_at = name.span().start;
            match name.get_ref().as_str() {
                "stops_spindle" => model.tool_change_stops_spindle = Some(flag(at, value.into_inner())?),
                "x_mm" => place[0] = Some((at, number(at, May::Any, value.into_inner())?)),
                "y_mm" => place[1] = Some((at, number(at, May::Any, value.into_inner())?)),
                "z_mm" => place[2] = Some((at, number(at, May::Any, value.into_inner())?)),
                _ => return Err(unknown(&name, &["stops_spindle", "x_mm", "y_mm", "z_mm"])),
            }
        }
        if place.iter().any(Option::is_some) {
            let [Some((_, x)), y, Some((_, z))] = place else {
                return Err((
                    table_at,
                    "where tools are changed needs x_mm and z_mm, and y_mm where there is a Y".to_owned(),
                ));
            };
            model.tool_change_at = Some([x, y.map_or(0.0, |(_, y)| y), z]);
        }
        for (axis, tables) in tables.axes.into_iter().enumerate() {
            for (table, values) in [
                ("homing", tables.homing),
                ("servo", tables.servo),
                ("mechanics", tables.mechanics),
            ] {
                for (name, value) in values {
                    let at = value.span().start;
                    let of_table = || AXIS_KEYS.iter().filter(|key| key.table == table).map(|key| key.name);
                    let key = AXIS_KEYS
                        .iter()
                        .position(|key| key.table == table && key.name == name.get_ref());
                    let Some(key) = key else {
                        return Err(unknown(&name, &of_table().collect::<Vec<_>>()));
                    };
                    let value = number(at, AXIS_KEYS[key].may, value.into_inner())?;
                    model.of_axes.insert((axis, key), value);
                }
            }
        }
        Ok(model)
    }

    fn number(&mut self, table: &str, others: &[&str], name: Spanned<String>, at: usize, value: Given) -> Result<(), Refusal> {
        let key = KEYS.iter().position(|key| key.table == table && key.name == name.get_ref());
        let Some(key) = key else {
            let of_table = KEYS.iter().filter(|key| key.table == table).map(|key| key.name);
            return Err(unknown(&name, &others.iter().copied().chain(of_table).collect::<Vec<_>>()));
        };
        self.numbers.insert(key, number(at, KEYS[key].may, value)?);
        Ok(())
    }

    /// Puts what the file says in the place of what is built in.
    fn put_into(&self, parameters: &mut MachineParameters) {
        for (key, value) in &self.numbers {
            *(KEYS[*key].of)(parameters) = *value;
        }
        for ((axis, key), value) in &self.of_axes {
            *(AXIS_KEYS[*key].of)(&mut parameters.axes[*axis]) = *value;
        }
        parameters.absolute_encoders = self.absolute_encoders.unwrap_or(parameters.absolute_encoders);
        parameters.position_law = self.position_law.unwrap_or(parameters.position_law);
        if let Some(stops) = self.tool_change_stops_spindle {
            parameters.tool_change_stops_spindle = stops;
        }
        parameters.tool_change_at = self
            .tool_change_at
            .map(|place| place.map(Millimetres))
            .or(parameters.tool_change_at);
    }
}

fn unknown(name: &Spanned<String>, expected: &[&str]) -> Refusal {
    let expected = expected.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    (
        name.span().start,
        format!("unknown field `{}`, expected one of {expected}", name.get_ref()),
    )
}

fn number(at: usize, may: May, value: Given) -> Result<f64, Refusal> {
    let Given::Number(value) = value else {
        return Err((at, "a number is needed".to_owned()));
    };
    may.be(value).map_err(|needed| (at, format!("{value} cannot be: {needed}")))?;
    Ok(value)
}

fn flag(at: usize, value: Given) -> Result<bool, Refusal> {
    match value {
        Given::Flag(value) => Ok(value),
        _ => Err((at, "true or false is needed".to_owned())),
    }
}

fn law(at: usize, value: Given) -> Result<PositionLaw, Refusal> {
    let word = match value {
        Given::Word(word) => word,
        Given::Flag(_) | Given::Number(_) => String::new(),
    };
    let found = LAWS.iter().find(|(name, _)| *name == word).map(|(_, law)| *law);
    found.ok_or_else(|| (at, "a position law is \"feed-forward\" or \"speed-set-point\"".to_owned()))
}

impl MachineFile {
    /// The machine for the realtime half and for the simulated iron: what the file says, and for the rest the drives of the built-in model of
    /// its kind.
    pub fn parameters(&self) -> MachineParameters {
        let mut parameters = match self.kind {
            MachineKind::Mill => MachineParameters::small_machining_centre(),
            MachineKind::Lathe => MachineParameters::small_lathe(),
        };
        for (axis, model) in Axis::ALL.into_iter().zip(&mut parameters.axes) {
            if let Some(file) = self.axis(axis) {
                (model.lowest, model.highest) = (file.travel_min, file.travel_max);
                (model.v_max, model.a_max, model.j_max) = (file.v_max, file.a_max, file.j_max);
                model.pulses_per_mm = file.pulses_per_mm;
                // The position at its reference is 0; where the travel does not hold that, the nearer end.
                let home = Millimetres(0f64.max(file.travel_min.0).min(file.travel_max.0));
                (model.homing.home, model.homing.reference) = (home, home);
                model.homing.upwards = file.home == super::HomeEnd::Max;
            }
        }
        parameters.spindle.highest = self.spindle.max;
        parameters.tool_change = self.tool_change;
        parameters.late_ticks_allowed = self.late_ticks_allowed;
        self.model.put_into(&mut parameters);
        parameters
    }

    /// Every key of the model with the value in force, in the order of the table: `axes.x.servo.position_rad_s_mm`, `102.2`.
    pub fn model_in_force(&self) -> Vec<(String, String)> {
        let mut parameters = self.parameters();
        let mut all = vec![
            ("loop.absolute_encoders".to_owned(), parameters.absolute_encoders.to_string()),
            (
                "loop.position_law".to_owned(),
                LAWS.iter()
                    .find(|(_, law)| *law == parameters.position_law)
                    .map_or_else(String::new, |(word, _)| format!("{word:?}")),
            ),
            (
                "tool_changer.stops_spindle".to_owned(),
                parameters.tool_change_stops_spindle.to_string(),
            ),
        ];
        match parameters.tool_change_at {
            None => all.push(("tool_changer.z_mm".to_owned(), "tools are changed on the spot".to_owned())),
            Some(place) => all.extend(
                Axis::ALL
                    .iter()
                    .zip(place)
                    .filter(|(axis, _)| self.axis(**axis).is_some())
                    .map(|(axis, mm)| {
                        (
                            format!("tool_changer.{}_mm", axis.to_string().to_lowercase()),
                            mm.0.to_string(),
                        )
                    }),
            ),
        }
        for key in KEYS {
            all.push((format!("{}.{}", key.table, key.name), (key.of)(&mut parameters).to_string()));
        }
        for axis in Axis::ALL.into_iter().filter(|axis| self.axis(*axis).is_some()) {
            let model = &mut parameters.axes[axis.index()];
            for key in AXIS_KEYS {
                let axis = axis.to_string().to_lowercase();
                all.push((format!("axes.{axis}.{}.{}", key.table, key.name), (key.of)(model).to_string()));
            }
        }
        all
    }

    /// What cannot be although each number could, with the key where it can be put right.
    pub(super) fn contradiction(&self) -> Option<(&'static str, String)> {
        let p = self.parameters();
        if p.following_warning > p.following_fault {
            let message = format!(
                "following_warning_mm {} must not be above following_fault_mm {}",
                p.following_warning.0, p.following_fault.0
            );
            return Some(("following_", message));
        }
        for axis in Axis::ALL.into_iter().filter(|axis| self.axis(*axis).is_some()) {
            let a = &p.axes[axis.index()];
            let (h, m) = (&a.homing, &a.mechanics);
            let inside = |place: Millimetres| (a.lowest..=a.highest).contains(&place);
            let no_faster = |speed: MmPerSec, name: &'static str| (speed > a.v_max).then_some((name, speed.0));
            if let Some((name, speed)) = no_faster(h.search, "search_mm_s").or(no_faster(h.slow_search, "slow_search_mm_s")) {
                return Some((
                    name,
                    format!("axis {axis}: {name} {speed} must not be above v_max_mm_s {}", a.v_max.0),
                ));
            }
            if h.slow_search > h.search {
                let message = format!(
                    "axis {axis}: slow_search_mm_s {} must not be above search_mm_s {}",
                    h.slow_search.0, h.search.0
                );
                return Some(("slow_search_mm_s", message));
            }
            for (name, place) in [("home_mm", h.home), ("reference_mm", h.reference)] {
                if !inside(place) {
                    let travel = format!("{} to {}", a.lowest.0, a.highest.0);
                    return Some((
                        name,
                        format!("axis {axis}: {name} {} must be within the travel, {travel}", place.0),
                    ));
                }
            }
            if m.peak_current < m.rated_current {
                let message = format!(
                    "axis {axis}: peak_current_a {} must not be below rated_current_a {}",
                    m.peak_current, m.rated_current
                );
                return Some(("_current_a", message));
            }
            for side in 0..2 {
                if m.static_friction[side] < m.coulomb_friction[side] {
                    let message = format!(
                        "axis {axis}: static friction, {} V, must not be below Coulomb friction, {} V",
                        m.static_friction[side], m.coulomb_friction[side]
                    );
                    return Some(("_friction_", message));
                }
            }
            if let Some(place) = p
                .tool_change_at
                .map(|place| place[axis.index()])
                .filter(|place| !inside(*place))
            {
                let travel = format!("{} to {}", a.lowest.0, a.highest.0);
                let name = ["x_mm", "y_mm", "z_mm"][axis.index()];
                return Some((
                    name,
                    format!("tool_changer.{name} {} must be within the travel, {travel}", place.0),
                ));
            }
            if p.slow_jog > a.v_max {
                return Some((
                    "slow_jog_mm_s",
                    format!("slow_jog_mm_s {} must not be above v_max_mm_s of {axis}", p.slow_jog.0),
                ));
            }
        }
        p.check().err().map(|error| (error.name, error.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine_file::BUILT_IN;

    /// The example's own lines, in force.
    fn uncommented(text: &str) -> String {
        let begin = text.find("# -- the machine itself").expect("the examples have it");
        let lines = text[begin..].lines().map(|line| match line.strip_prefix("# ") {
            Some(rest) if rest.starts_with('[') || rest.split_once(" = ").is_some_and(|(key, _)| !key.contains(' ')) => rest,
            _ => line,
        });
        let head = text[..begin].replacen("driver = \"sim\"", "driver = \"card\"", 1);
        format!("{head}{}", lines.collect::<Vec<_>>().join("\n"))
    }

    #[test]
    fn the_examples_hold_every_key_with_its_default() {
        for (name, text) in BUILT_IN {
            let plain = MachineFile::parse(text, name).expect("built in");
            let in_force = uncommented(text);
            let said = MachineFile::parse(&in_force, name).expect("its own values can be");
            assert_eq!(said.parameters(), plain.parameters(), "{name}");
            let told = MachineFile::told(&in_force, name).expect("as well");
            for (key, value) in plain.model_in_force() {
                if key == "tool_changer.z_mm" {
                    continue;
                }
                let there = told
                    .iter()
                    .find(|told| told.key == key)
                    .unwrap_or_else(|| panic!("{name} has no {key}"));
                let same = there.value == value || there.value.parse::<f64>().ok() == value.parse::<f64>().ok();
                assert!(same, "{name} {key}: {} for {value}", there.value);
            }
        }
    }

    #[track_caller]
    fn check_refused(lines: &str, expected: &str) {
        let text = format!("{}\n{lines}", BUILT_IN[0].1);
        let above = BUILT_IN[0].1.lines().count() as u32;
        let refused = MachineFile::parse(&text, "m.toml").expect_err(expected).to_string();
        let (line, rest) = expected.split_once(':').expect("line and rest");
        let line = above + 1 + line.parse::<u32>().expect("a line");
        assert!(refused.starts_with(&format!("error: m.toml:{line}:{rest}")), "{refused}");
    }

    #[test]
    fn what_cannot_be_is_refused_with_its_line() {
        check_refused(
            "[loop]\nfollowing_fault_mm = -1",
            "2:22: -1 cannot be: a finite number above 0",
        );
        check_refused(
            "[loop]\nfollowing_falt_mm = 1",
            "2:1: unknown field `following_falt_mm`, expected one of `absolute_encoders`",
        );
        check_refused("[loop]\nfollowing_fault_mm = \"far\"", "2:22: a number is needed");
        check_refused("[loop]\nabsolute_encoders = 1", "2:21: true or false is needed");
        check_refused("[loop]\nposition_law = \"fast\"", "2:16: a position law is \"feed-forward\"");
        check_refused(
            "[loop]\nfollowing_warning_mm = 0.7",
            "2:24: following_warning_mm 0.7 must not be above following_fault_mm 0.5",
        );
        check_refused(
            "[spindle.drive]\ntolerance_part = 1.5",
            "2:18: 1.5 cannot be: 0 to 1 is needed",
        );
        check_refused(
            "[spindle.drive]\nencoder_counts_per_turn = 0.5",
            "2:27: 0.5 cannot be: a whole number",
        );
        check_refused("[spindle.drive]\nresponse_s = nan", "2:14: NaN cannot be");
        check_refused(
            "[axes.y.servo]\nintegral_time_s = 0",
            "2:19: 0 cannot be: a finite number above 0",
        );
        check_refused("[axes.w.servo]\nintegral_time_s = 1", "1:7: unknown field `w`");
        check_refused(
            "[axes.x.homing]\nsearch_mm_s = 900",
            "2:15: axis X: search_mm_s 900 must not be above v_max_mm_s 500",
        );
        check_refused(
            "[axes.z.homing]\nhome_mm = 501",
            "2:11: axis Z: home_mm 501 must be within the travel, -700 to 500",
        );
        check_refused(
            "[axes.z.mechanics]\npeak_current_a = 1",
            "2:18: axis Z: peak_current_a 1 must not be below",
        );
        check_refused("[tool_changer]\nx_mm = 0", "2:1: where tools are changed needs x_mm and z_mm");
        check_refused(
            "[tool_changer]\nx_mm = 0\ny_mm = 0\nz_mm = 900",
            "4:8: tool_changer.z_mm 900 must be within the travel",
        );
        check_refused("[card]\nregister = \"r\"", "2:1: unknown field `register`");
    }

    #[test]
    fn what_a_file_says_is_in_the_machine_and_the_rest_is_as_built_in() {
        let text = format!(
            "{}\n[loop]\nabsolute_encoders = false\nposition_law = \"speed-set-point\"\nslow_jog_mm_s = 3\n[tool_changer]\nstops_spindle = false\nx_mm = -10\n\
             y_mm = 5\nz_mm = 400\n[spindle.drive]\nencoder_counts_per_turn = 1024\n[axes.y.homing]\nreference_mm = 499.5\n",
            BUILT_IN[0].1
        );
        let plain = MachineFile::simulated(MachineKind::Mill).parameters();
        let mut expected = plain;
        expected.absolute_encoders = false;
        expected.position_law = PositionLaw::SpeedSetPoint;
        expected.slow_jog = MmPerSec(3.0);
        expected.tool_change_stops_spindle = false;
        expected.tool_change_at = Some([-10.0, 5.0, 400.0].map(Millimetres));
        expected.spindle.encoder_counts = 1024.0;
        expected.axes[1].homing.reference = Millimetres(499.5);
        assert_eq!(
            MachineFile::parse(&text, "m.toml").expect("all can be").parameters(),
            expected
        );
    }
}
