//! Files for the core, which opens none itself: a program read by position, the files beside it, and whole files written.

use crate::failure::Failure;
use plan::{ByteSource, ReadError, Resolver};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// An open file that is read by position, so that a program of any size passes through a small window.
pub struct FileSource {
    file: File,
    length: u64,
}

impl FileSource {
    /// Opens a file.
    ///
    /// # Errors
    /// It does not exist, is a folder, or may not be read.
    pub fn open(path: &Path) -> std::io::Result<FileSource> {
        let file = File::open(path)?;
        let metadata = file.metadata()?;
        if metadata.is_dir() {
            return Err(std::io::Error::new(std::io::ErrorKind::IsADirectory, "it is a folder"));
        }
        Ok(FileSource {
            file,
            length: metadata.len(),
        })
    }
}

impl ByteSource for FileSource {
    fn length(&self) -> u64 {
        self.length
    }
    fn read_at(&mut self, offset: u64, buffer: &mut [u8]) -> Result<usize, ReadError> {
        let mut done = 0;
        while done < buffer.len() {
            match self.file.read_at(&mut buffer[done..], offset + done as u64) {
                Ok(0) => break,
                Ok(count) => done += count,
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => return Err(ReadError(error.to_string())),
            }
        }
        Ok(done)
    }
}

/// Finds what a program calls by name in the program's own folder: `O9000` as `O9000`, `O9000.nc`, `o9000.NC` ...
pub struct FolderResolver {
    folder: PathBuf,
}

impl FolderResolver {
    /// The folder of `program`.
    pub fn beside(program: &Path) -> FolderResolver {
        FolderResolver {
            folder: program.parent().map(Path::to_path_buf).unwrap_or_default(),
        }
    }
}

impl Resolver for FolderResolver {
    fn open(&mut self, name: &str) -> Option<Box<dyn ByteSource>> {
        // A name that leads out of the folder is not a name of a program.
        if name.is_empty() || name.contains(['/', '\\']) || name.starts_with('.') {
            return None;
        }
        ["", ".nc", ".NC", ".tap", ".ngc"]
            .iter()
            .find_map(|ending| FileSource::open(&self.folder.join(format!("{name}{ending}"))).ok())
            .map(|source| Box::new(source) as Box<dyn ByteSource>)
    }
}

/// Writes a whole file.
///
/// # Errors
/// The disk refuses.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    std::fs::write(path, bytes).map_err(|e| Failure::writing(path, e))
}
