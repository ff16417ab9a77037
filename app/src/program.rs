//! A program on disk, whatever it is written in, as the stream that planner and rebuild read.

use crate::failure::Failure;
use crate::files::{FileSource, FolderResolver};
use gcode::{GcodeProgram, Profile};
use ledger::{Hash, Hashing};
use plan::{ByteSource, ProgramStream, Tables};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stepnc::{StepNcStream, StreamOptions};
use store::machine_file::MachineKind;
use store::{MachineFile, StoreError};

/// A program that was opened; its steps are read again for each [`Program::stream`].
pub struct Program {
    /// Where it is.
    pub path: PathBuf,
    /// Its file name, as messages call it.
    pub name: String,
    /// Hash of its bytes.
    pub hash: Hash,
    /// What it is written in.
    pub kind: Kind,
    /// Parameters of the control that decide how the program is read.
    pub parameters: gcode::Parameters,
    /// Variables that the control has kept from earlier programs.
    pub variables: BTreeMap<u32, f64>,
}

/// What a program is written in.
pub enum Kind {
    /// STEP-NC.
    StepNc(Arc<stepnc::Program>),
    /// G-code of a control family.
    Gcode {
        /// The family.
        profile: &'static Profile,
        /// Why it is taken for that.
        because: String,
    },
    /// A cutter-location file (APT).
    CutterLocation,
}

impl Program {
    /// Opens a program. The control family of G-code is `dialect`, else the machine's, else found out from the text.
    ///
    /// # Errors
    /// There is no such file, it cannot be read as a program, or `dialect` is unknown.
    pub fn open(path: &Path, dialect: Option<&str>, machine: Option<&MachineFile>) -> Result<Program, Failure> {
        let name = path
            .file_name()
            .map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
        let unreadable = |error: &dyn std::fmt::Display| Failure::unreadable(format_args!("{}: {error}", path.display()));
        let wanted = dialect.map(known_dialect).transpose()?;
        let mut parameters = gcode::Parameters::default();
        for (key, value) in machine.iter().flat_map(|m| &m.control_parameters) {
            parameters.set(key, *value).map_err(Failure::unreadable)?;
        }
        let mut source = FileSource::open(path).map_err(|e| unreadable(&e))?;
        if source.length() == 0 {
            return Err(Failure::unreadable(format_args!(
                "{}:1:1: the file is empty; a program was expected",
                path.display()
            )));
        }
        let mut head = vec![0; 4096];
        let count = source.read_at(0, &mut head).map_err(|e| unreadable(&e))?;
        head.truncate(count);
        if is_part21(&head) || has_step_ending(path) {
            let bytes = whole(&mut source).map_err(|e| unreadable(&e))?;
            let hash = Hash::of(&bytes);
            let program =
                stepnc::Program::read(&name, bytes).map_err(|e| Failure::unreadable(format_args!("{}: {e}", path.display())))?;
            return Ok(Program {
                path: path.to_owned(),
                name,
                hash,
                kind: Kind::StepNc(Arc::new(program)),
                parameters,
                variables: BTreeMap::new(),
            });
        }
        if wanted.is_none() && (has_apt_ending(path) || apt::AptProgram::looks_like(&head)) {
            let hash = hash_of(&mut source).map_err(|e| unreadable(&e))?;
            return Ok(Program {
                path: path.to_owned(),
                name,
                hash,
                kind: Kind::CutterLocation,
                parameters,
                variables: BTreeMap::new(),
            });
        }
        let (profile, because) = match (wanted, machine.and_then(|m| m.control)) {
            (Some(known), _) => (known, "given by --dialect".to_owned()),
            (None, Some(control)) => {
                let known = gcode::profile::by_name(control.word()).ok_or_else(|| {
                    Failure::usage(format_args!(
                        "the control '{}' of the machine file is unknown",
                        control.word()
                    ))
                })?;
                (known, "the machine file says so".to_owned())
            }
            (None, None) => {
                let found = gcode::detect(&mut source).map_err(|e| unreadable(&e))?;
                (found.profile, found.because)
            }
        };
        let hash = hash_of(&mut source).map_err(|e| unreadable(&e))?;
        Ok(Program {
            path: path.to_owned(),
            name,
            hash,
            kind: Kind::Gcode { profile, because },
            parameters,
            variables: BTreeMap::new(),
        })
    }

    /// The program as a stream from its beginning.
    ///
    /// # Errors
    /// It cannot be read (any more).
    pub fn stream(&self, tables: &Tables) -> Result<Box<dyn ProgramStream>, Failure> {
        match &self.kind {
            Kind::StepNc(program) => {
                let options = StreamOptions {
                    tables: tables.clone(),
                    ..StreamOptions::default()
                };
                Ok(Box::new(StepNcStream::new(Arc::clone(program), options)))
            }
            Kind::Gcode { .. } => Ok(Box::new(self.gcode(tables)?)),
            Kind::CutterLocation => Ok(Box::new(self.cutter_location(tables)?)),
        }
    }

    /// A G-code program as what it is.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn gcode(&self, tables: &Tables) -> Result<GcodeProgram, Failure> {
        self.gcode_with(tables, self.variables.clone())
    }

    /// The same with other values in the variables that the control has kept.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn gcode_with(&self, tables: &Tables, variables: BTreeMap<u32, f64>) -> Result<GcodeProgram, Failure> {
        let Kind::Gcode { profile, .. } = &self.kind else {
            return Err(Failure::usage(format_args!("{} is not G-code", self.path.display())));
        };
        let source =
            FileSource::open(&self.path).map_err(|e| Failure::unreadable(format_args!("{}: {e}", self.path.display())))?;
        let resolver = Box::new(FolderResolver::beside(&self.path));
        GcodeProgram::open(
            Box::new(source),
            &self.name,
            profile,
            resolver,
            tables.clone(),
            gcode::Options {
                variables,
                parameters: self.parameters.clone(),
                ..gcode::Options::default()
            },
        )
        .map_err(|found| Failure {
            exit: crate::failure::Exit::Unreadable,
            message: found.to_string(),
        })
    }

    /// A cutter-location file as what it is.
    ///
    /// # Errors
    /// It cannot be read (any more).
    pub fn cutter_location(&self, tables: &Tables) -> Result<apt::AptProgram, Failure> {
        let unreadable = |error: &dyn std::fmt::Display| Failure::unreadable(format_args!("{}: {error}", self.path.display()));
        let source = FileSource::open(&self.path).map_err(|e| unreadable(&e))?;
        apt::AptProgram::open(Box::new(source), &self.name, tables.clone()).map_err(|e| unreadable(&e))
    }

    /// True when the program turns: it is a lathe's.
    pub fn turns(&self) -> bool {
        match &self.kind {
            Kind::StepNc(program) => program.turns(),
            Kind::Gcode { profile, .. } => profile.turning,
            Kind::CutterLocation => false,
        }
    }

    /// The STEP-NC behind it, if it is one.
    pub fn step_nc(&self) -> Option<&Arc<stepnc::Program>> {
        match &self.kind {
            Kind::StepNc(program) => Some(program),
            Kind::Gcode { .. } | Kind::CutterLocation => None,
        }
    }

    /// What it is written in, and why it is taken for that.
    pub fn dialect(&self) -> (&str, &str) {
        match &self.kind {
            Kind::StepNc(_) => ("step-nc", "it is a Part 21 file"),
            Kind::Gcode { profile, because } => (profile.name, because),
            Kind::CutterLocation => ("cutter-location", "its statements are APT's"),
        }
    }
}

/// The machine that `--machine` means for a program.
///
/// # Errors
/// There is no such machine file, or it is one that this command cannot drive.
pub fn machine_for(wanted: &str, turns: bool) -> Result<MachineFile, Failure> {
    if wanted == "sim" {
        return Ok(MachineFile::simulated(if turns {
            MachineKind::Lathe
        } else {
            MachineKind::Mill
        }));
    }
    if wanted.contains("://") {
        return Err(Failure::usage(format_args!(
            "--machine {wanted}: only run and live drive a controller; use sim, sim-mill, sim-lathe or a machine file"
        )));
    }
    MachineFile::find(wanted).map_err(|error| match error {
        StoreError::Io { source, .. } => Failure::unreadable(format_args!(
            "--machine {wanted}: {source}; use sim, sim-mill, sim-lathe or a machine file"
        )),
        other => crate::shop::failure(other),
    })
}

/// The machine, before a program is known to turn or not: only what its control is matters then.
///
/// # Errors
/// There is no such machine file.
pub fn named_machine(wanted: &str) -> Result<Option<MachineFile>, Failure> {
    if wanted == "sim" {
        Ok(None)
    } else {
        machine_for(wanted, false).map(Some)
    }
}

fn known_dialect(wanted: &str) -> Result<&'static Profile, Failure> {
    gcode::profile::by_name(wanted).ok_or_else(|| {
        let names: Vec<&str> = gcode::PROFILES.iter().map(|p| p.name).collect();
        Failure::usage(format_args!("--dialect {wanted} is unknown; known are {}", names.join(", ")))
    })
}

/// True for the first bytes of a Part 21 file.
pub fn is_part21(head: &[u8]) -> bool {
    let text = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    let text = text.trim_ascii_start();
    text.starts_with(b"ISO-10303-21") || text.starts_with(b"/*")
}

fn has_apt_ending(path: &Path) -> bool {
    ending(path, &["cls", "cl", "apt", "aptsource", "ncl"])
}

fn has_step_ending(path: &Path) -> bool {
    ending(path, &["stpnc", "stp", "step", "p21", "238"])
}

fn ending(path: &Path, known: &[&str]) -> bool {
    let ending = path
        .extension()
        .map(|e| e.to_string_lossy().to_lowercase())
        .unwrap_or_default();
    known.contains(&ending.as_str())
}

fn whole(source: &mut FileSource) -> Result<Vec<u8>, plan::ReadError> {
    let length = usize::try_from(source.length()).map_err(|_| plan::ReadError("it does not fit into memory".into()))?;
    let mut bytes = vec![0; length];
    let count = source.read_at(0, &mut bytes)?;
    bytes.truncate(count);
    Ok(bytes)
}

fn hash_of(source: &mut FileSource) -> Result<Hash, plan::ReadError> {
    let mut hashing = Hashing::default();
    let mut window = vec![0; 1 << 16];
    let mut offset = 0;
    loop {
        let count = source.read_at(offset, &mut window)?;
        if count == 0 {
            return Ok(hashing.finish());
        }
        hashing.update(&window[..count]);
        offset += count as u64;
    }
}
