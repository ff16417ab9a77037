//! Damaged programs: whatever the bytes, reading ends, never panics, and says where it stopped.

mod common;

use common::{lathe_tables, mill_tables, open_with};
use gcode::inspect::inspect;
use gcode::{GcodeProgram, Options, PROFILES, detect};
use plan::{Answer, MemorySource, Next, ProgramStream, StepKind};
use proptest::prelude::*;

const SEEDS: [&str; 9] = [
    include_str!("../../../corpus/plate.nc"),
    include_str!("../../../corpus/shaft.nc"),
    include_str!("../../../corpus/spindle.nc"),
    include_str!("../../../corpus/flange.nc"),
    "G21 G18 G99 T0101\nG10 P10001 R0.4 Q3\nG97 S500 M3 F.1\nG0 X40. Z2.\nG72 W2. R.5\nG72 P1 Q3 U.4 W.2\nN1 G0 Z-5.\nN2 G1 X20. Z-3.\nN3 Z0\nG73 U3. W1. R3\nG73 P4 Q6 U.4\nN4 G42 G0 X20. Z1.\nN5 G1 Z-10. R2.\nN6 G40 X30. Z-12.\nG70 P4 Q6\nG90 X30. Z-9. R-1.\nG94 X9. Z-2.\nG92 X28. Z-9. F2.\nG74 R.5\nG74 X12. Z-9. P3000 Q4000\nG75 X8. P2000\nG32 Z-20. F1.5 Q9000\nG76 P021060 Q100 R.05\nG76 X18. Z-20. P1000 Q500 F2.\nG76 X17. Z-9. K1. D500 F2. A60\nM30",
    "G21 G90 G54 T2 M6\nM3 S900 F90.\nG0 X-20. Y0 Z0\nG10 L12 P2 R3.\nG41 D2 G1 X0 Y0\nY20. ,R5.\nX20. ,C2.\nG2 X30. Y10. R10.\nG3 X40. Y10. I5. J0\nM8\nZ-2.\nX0 Y0\nG42 X9. Y3.\nG40 X-20.\nG31 Z-3.\nM29\nG84 X1. Y2. Z-9. R2. F900.\nG76 X3. Q.5\nG87 X5. R-9. Z-3. Q2.\nG88 X7. Z-3. R1.\nG80\nM19\nM30",
    "(MSG, x)\nG21 G64 P0.02 G90\nG43 H1\nS1000 M3\nG93 G1 X20 F2\nG94 G90.1 G2 X0 Y0 I10 J0 F9\nG3 X0 Y0 Z-2 I5 P2\n#1=5\nG0 X[#1*2]\nG92 X0\nM2\n",
    "O1\nG20\n#1=1.2345\n#[#1+2]=ROUND[#1/3]\nG90 G10 L2 P#1 X#1\nG0 X-#1 Y[SIN[30]+ATAN[1]/[2]]\nM98 P2\nG91 G81 X1. Z-1. R-.1 K3 F9.\nG84 Z-2. S100 M3\nM1\n#5221=1\n#3006=1(LOOK)\nM30\nO2\nG1 X1. F5.\nM99\n",
    "G21 G17 G3 X1. Y1. R1. F100.\nG18 G2 X0 Z0 I5.\nG19 G2 Y3. Z3. R-9.\nG53 Z0\nG28 X0\nG30 Y0\nG4 P100\nG54.1 P3\nG52 X1.\nG41 D1\nG9 X3.\n",
];

/// Reads a program as every family; gives up on long ones, whose first part tells as much.
fn read(text: &[u8]) -> Result<(), TestCaseError> {
    detect(&mut MemorySource(text.to_vec())).expect("memory can be read");
    for profile in PROFILES {
        let tables = if profile.turning { lathe_tables() } else { mill_tables() };
        let tables = plan::Tables {
            missing: plan::Missing::Assume,
            ..tables
        };
        let Ok(mut program) = open_with(text, profile.name, tables, Options::default()) else {
            continue;
        };
        let mut answer = None;
        for expected in 1..100_000 {
            match program.next(answer.take()) {
                Next::Step(step) => {
                    prop_assert!(step.id.0 <= expected);
                    if let StepKind::Move(m) = &step.kind {
                        prop_assert!(m.path.is_sound(), "{:?}", m.path);
                    }
                }
                Next::Ask(_) => answer = Some(Answer::Truth(false)),
                Next::End => break,
                Next::Alarm(alarm) => {
                    prop_assert!(alarm.diagnostic.line > 0 && alarm.diagnostic.column > 0, "{}", alarm);
                    prop_assert!(!alarm.diagnostic.message.is_empty());
                    prop_assert_eq!(program.next(None), Next::Alarm(alarm));
                    break;
                }
            }
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_truncated_program_never_panics(seed in 0..SEEDS.len(), share in 0.0..1.0_f64) {
        let text = SEEDS[seed].as_bytes();
        read(&text[..(text.len() as f64 * share) as usize])?;
    }

    #[test]
    fn a_damaged_program_never_panics(
        seed in 0..SEEDS.len(),
        damage in prop::collection::vec((0.0..1.0_f64, 0..4_u8, any::<u8>(), prop::sample::select(b"GMTXYZIJKRFSPQ#[]().-=/% \n0123456789".to_vec())), 1..12),
    ) {
        let mut text = SEEDS[seed].as_bytes().to_vec();
        for (place, way, byte, usual) in damage {
            let at = ((text.len() as f64 * place) as usize).min(text.len().saturating_sub(1));
            match way {
                0 => text[at] = byte,
                1 => text[at] = usual,
                2 => text.insert(at, usual),
                _ => { text.remove(at); }
            }
            if text.is_empty() { text.push(b'%'); }
        }
        read(&text)?;
    }

    #[test]
    fn any_words_in_any_order_never_panic(
        words in prop::collection::vec((prop::sample::select(b"GMTXYZIJKRFSPQHDLUWN".to_vec()), -200..3000_i32, any::<bool>(), prop::sample::select(vec![" ", "\n"])), 1..80),
    ) {
        let mut text = String::new();
        for (letter, number, tenths, gap) in words {
            text.push(char::from(letter));
            let number = if letter == b'G' || letter == b'M' { number.rem_euclid(100) } else { number };
            text += &if tenths { format!("{}.{}", number, number.rem_euclid(10)) } else { number.to_string() };
            text += gap;
        }
        read(text.as_bytes())?;
    }
}

#[test]
fn inspection_of_a_program_that_alarms_ends_with_the_alarm() {
    let mut program = open_with(
        b"G21 G0 X1. Y2.\nG1 X3.\nM30",
        "fanuc-mill",
        mill_tables(),
        Options::default(),
    )
    .expect("it opens");
    let tree = inspect(&mut program, "fanuc-mill", GcodeProgram::in_inches);
    assert_eq!(
        tree.problems.last().map(|d| (d.code, d.line, d.column)),
        Some(("no-feed", 2, 4))
    );
    assert_eq!(tree.summary.rapids, 1);
}
