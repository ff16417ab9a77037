//! A controller whose axes are behind the registers of a card: another thread plays the card and its iron on the file, by what
//! `docs/register-card.md` says and nothing else.

#![cfg(unix)]

#[path = "support/machine_side.rs"]
mod machine_side;

use machine_side::{Controller, PLATE, report, toolmark, words};
use serde_json::Value;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// A program with a tool length that is in no table.
const UNKNOWN: &str = "%\nO2\nG21 G90 G17 G54\nT1 M6\nG43 H77\nG0 X0 Y0\nM30\n%\n";

/// Highest speed of each axis, mm/s: so slow that a count which comes a cycle or two late on a shared computer is still possible.
const V_MAX: f64 = 24.0;
const PULSES_PER_MM: f64 = 1000.0;
const MAX_RPM: f64 = 18_000.0;
/// An index pulse each so many mm.
const TURN: f64 = 10.0;
/// The reference switches are made from here on upwards.
const SWITCH: f64 = -4.0;

/// The card's side of the file, and the iron.
struct Card {
    file: File,
    /// Where the axes are, machine frame, mm; the encoders count from where they were at power-on.
    position: [f64; 3],
    power_on: [f64; 3],
    index: [i32; 3],
    index_count: [u8; 4],
    rpm: f64,
    turns: f64,
    spindle_index: i32,
    alive: i32,
}

impl Card {
    fn new(path: &Path, position: [f64; 3]) -> Card {
        std::fs::write(path, [0; 128]).expect("a file");
        Card {
            file: File::options().read(true).write(true).open(path).expect("it is there"),
            position,
            power_on: position,
            index: [0; 3],
            index_count: [0; 4],
            rpm: 0.0,
            turns: 0.0,
            spindle_index: 0,
            alive: 0,
        }
    }

    fn cycle(&mut self, seconds: f64) {
        let mut bytes = [0; 24];
        self.file.read_exact_at(&mut bytes, 64).expect("the controller's words");
        let out: Vec<i32> = bytes.as_chunks().0.iter().map(|word| i32::from_le_bytes(*word)).collect();
        let mut inputs = 1 << 3 | 1 << 4;
        for k in 0..3 {
            let speed = if out[4] & 1 != 0 {
                f64::from(out[k]) / 32_767.0 * V_MAX
            } else {
                0.0
            };
            let before = (self.position[k] / TURN).floor();
            self.position[k] += speed * seconds;
            let now = (self.position[k] / TURN).floor();
            if before != now {
                self.index[k] = ((before.max(now) * TURN - self.power_on[k]) * PULSES_PER_MM).round() as i32;
                self.index_count[k] = self.index_count[k].wrapping_add(1);
            }
            inputs |= i32::from(self.position[k] >= SWITCH) << k;
        }
        let wanted = match out[4] & 0b110 {
            0b010 => f64::from(out[3]) / 32_767.0 * MAX_RPM,
            0b100 => -f64::from(out[3]) / 32_767.0 * MAX_RPM,
            _ => 0.0,
        };
        self.rpm += (wanted - self.rpm) * (seconds / 0.05).min(1.0);
        let before = self.turns.floor();
        self.turns += self.rpm / 60.0 * seconds;
        if before != self.turns.floor() {
            self.spindle_index = (before.max(self.turns.floor()) * 4096.0) as i32;
            self.index_count[3] = self.index_count[3].wrapping_add(1);
        }
        self.alive += 1;
        let counts: [i32; 3] = std::array::from_fn(|k| ((self.position[k] - self.power_on[k]) * PULSES_PER_MM).round() as i32);
        let words = [
            counts[0],
            counts[1],
            counts[2],
            self.index[0],
            self.index[1],
            self.index[2],
            i32::from_le_bytes(self.index_count),
            inputs,
            self.rpm.round() as i32,
            (self.turns * 4096.0).round() as i32,
            self.spindle_index,
            // A busy computer may keep this thread away for longer than a card may be silent: this one does not say that it works.
            0,
        ];
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        self.file.write_all_at(&bytes, 0).expect("the card's words");
    }

    /// Plays until it is over. When this thread was away the iron has waited, as simulated iron does.
    fn play(mut self, over: &AtomicBool) {
        let mut last = Instant::now();
        while !over.load(Relaxed) {
            std::thread::sleep(Duration::from_micros(400));
            let now = Instant::now();
            self.cycle((now - last).as_secs_f64().min(0.002));
            last = now;
        }
    }
}

/// A small mill on the card: slow axes, encoders that count from power-on, and the part near home.
fn machine_file(folder: &Path, registers: &Path) -> String {
    let mill = include_str!("../../store/machines/sim-mill.toml");
    let text = mill
        .replacen("driver = \"sim\"", "driver = \"card\"", 1)
        .replacen("tool_change_s = 2.5", "tool_change_s = 0.2", 1)
        .replacen("kind = \"mill\"", "late_ticks_allowed = 100\nkind = \"mill\"", 1)
        .replace("v_max_mm_s = 500.0", &format!("v_max_mm_s = {V_MAX:.1}"))
        .replacen(
            "x_mm = -500.0\ny_mm = -350.0\nz_mm = -500.0",
            "x_mm = -40.0\ny_mm = -40.0\nz_mm = -150.0",
            1,
        );
    let card = format!(
        "[loop]\nabsolute_encoders = false\nposition_law = \"speed-set-point\"\nfollowing_warning_mm = 2.0\nfollowing_fault_mm = 6.0\n\
         [axes.x.homing]\nsearch_mm_s = 20.0\n[axes.y.homing]\nsearch_mm_s = 20.0\n[axes.z.homing]\nsearch_mm_s = 20.0\n\
         [card]\nregisters = \"{}\"\n",
        registers.display()
    );
    let path = folder.join("card-mill.toml");
    std::fs::write(&path, format!("{text}\n{card}")).expect("written");
    path.display().to_string()
}

#[test]
fn a_controller_on_a_card_is_homed_when_it_is_asked_for_and_machines_a_plate_over_the_link() {
    let folder = tempfile::tempdir().expect("a folder");
    let registers = folder.path().join("registers");
    let machine = machine_file(folder.path(), &registers);
    let plate = folder.path().join("plate.nc");
    std::fs::write(&plate, PLATE).expect("written");
    let plate = plate.display().to_string();
    let data = folder.path().join("data");

    let here = toolmark(&["run", &plate, "--machine", &machine], &data)
        .output()
        .expect("it runs");
    assert_eq!(here.status.code(), Some(2), "{}", words(&here));
    assert!(words(&here).contains("is moved by its card"), "{}", words(&here));

    // The card's program starts first.
    let early = toolmark(
        &["controller", "--machine", &machine, "--port", "0"],
        &folder.path().join("other"),
    );
    let early = { early }.output().expect("it runs");
    assert_eq!(early.status.code(), Some(4), "{}", words(&early));
    assert!(words(&early).contains("registers"), "{}", words(&early));

    let over = Arc::new(AtomicBool::new(false));
    let card = Card::new(&registers, [-12.0, -9.0, -15.0]);
    let playing = std::thread::spawn({
        let over = Arc::clone(&over);
        move || card.play(&over)
    });
    std::thread::sleep(Duration::from_millis(50));
    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    assert_eq!(
        (&controller.told["simulated"], &controller.told["late_ticks_made_up"]),
        (&Value::from(false), &Value::from(0))
    );
    let run = |more: &[&str]| {
        let args = [
            "run",
            &plate,
            "--machine",
            &controller.address,
            "--machine-file",
            &machine,
            "--json",
        ];
        toolmark(&[&args[..], more].concat(), &data).output().expect("it runs")
    };
    // Nobody but a person makes real axes look for their references.
    let refused = run(&[]);
    assert_eq!(refused.status.code(), Some(4), "{}", words(&refused));
    assert!(
        words(&refused).contains("does not know where its axes are") && words(&refused).contains("--home"),
        "{}",
        words(&refused)
    );
    for attempt in 0..6 {
        let out = folder.path().join(format!("out-{attempt}"));
        let done = run(&["--home", "--out", &out.display().to_string()]);
        let answer: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
        println!("{attempt}: {} {} {}", answer["ended"], answer["text"], answer["driven"]);
        let late = answer["driven"]["late_ticks"].as_u64();
        if answer["ended"] != "completed" && late > Some(0) {
            // Real drives do not wait for a computer that is busy.
            continue;
        }
        assert_eq!(
            (done.status.code(), &answer["ended"]),
            (Some(0), &Value::from("completed")),
            "{}",
            words(&done)
        );
        let told = report(&out);
        assert_eq!(
            (&told["verdict"], &told["simulated"]),
            (&Value::from("good"), &Value::from(false)),
            "{told}"
        );
        let page = std::fs::read_to_string(out.join("report.html")).expect("a page");
        assert!(!page.contains("SIMULATED"));
        // A plan from the file of a simulator does not make this machine one: a length that nobody measured is not zero here.
        let text = std::fs::read_to_string(&machine).expect("the machine file");
        let (simulator, _) = text.rsplit_once("[card]\n").expect("it has a card");
        let simulator = simulator.replacen("driver = \"card\"", "driver = \"sim\"", 1);
        std::fs::write(folder.path().join("simulator.toml"), simulator).expect("written");
        std::fs::write(folder.path().join("unknown.nc"), UNKNOWN).expect("written");
        for file in ["card-mill.toml", "simulator.toml"] {
            let mut run = toolmark(
                &["run", "unknown.nc", "--machine", &controller.address, "--machine-file", file],
                &data,
            );
            let refused = run.current_dir(folder.path()).output().expect("it runs");
            assert_eq!(refused.status.code(), Some(1), "{file}: {}", words(&refused));
            assert!(words(&refused).contains("H77"), "{file}: {}", words(&refused));
        }
        let end = controller.end();
        assert_eq!(end["at_rest"], true, "{end}");
        over.store(true, Relaxed);
        playing.join().expect("it plays on");
        return;
    }
    panic!("six runs were kept from the processor");
}
