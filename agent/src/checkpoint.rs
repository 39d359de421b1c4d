//! Checkpoints on disk: the newest and the one before it, so that a process that dies while it writes loses nothing.
//!
//! A checkpoint is written beside the others, brought to the disk, and only then takes the place of the newest, which
//! becomes the previous one.

use crate::queue::{Queue, WhenFull};
use skein_proto::name::Name;
use skein_vehicle::Checkpoint;
use skein_vehicle::checkpoint::CHECKPOINT_BYTES;
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

/// Checkpoints that wait for the disk: only the newest is worth writing.
const WAITING_MAX: usize = 1;

/// The checkpoint that a restart resumes from: the newest that is whole. What is damaged is told of in the log.
pub fn load(path: &Path, vehicle: Name) -> Option<Checkpoint> {
    [path.to_owned(), previous(path)]
        .into_iter()
        .find_map(|path| read(&path, vehicle))
}

fn read(path: &Path, vehicle: Name) -> Option<Checkpoint> {
    let mut bytes = Vec::new();
    // One byte more than a checkpoint has tells that a file is another one, however long.
    let longest = CHECKPOINT_BYTES as u64 + 1;
    let read = File::open(path).and_then(|file| file.take(longest).read_to_end(&mut bytes));
    match read {
        Ok(_) => {}
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return None,
        Err(error) => {
            tracing::warn!(checkpoint = %path.display(), %error, "a checkpoint cannot be read");
            return None;
        }
    }
    Checkpoint::decode(vehicle, &bytes)
        .inspect_err(|error| {
            tracing::warn!(checkpoint = %path.display(), %error, "a checkpoint is not used");
        })
        .ok()
}

fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(ending);
    path.with_file_name(name)
}

fn previous(path: &Path) -> PathBuf {
    beside(path, ".previous")
}

/// Writes a checkpoint so that at every moment a whole one is on the disk.
pub fn store(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let new = beside(path, ".new");
    let mut file = File::create(&new)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    match std::fs::rename(path, previous(path)) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    std::fs::rename(&new, path)?;
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty());
    // The names are brought to the disk too.
    File::open(folder.unwrap_or(Path::new(".")))?.sync_all()
}

/// Writes checkpoints in a thread of its own: a slow disk holds up nobody.
pub(crate) struct CheckpointWriter {
    vehicle: Name,
    waiting: Queue<Checkpoint>,
    writing: Option<JoinHandle<()>>,
}

impl CheckpointWriter {
    /// Starts the thread, and makes the folder where it is missing.
    pub(crate) fn start(path: &Path, vehicle: Name) -> std::io::Result<Self> {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        let waiting = Queue::new(WAITING_MAX, WhenFull::DropOldest);
        let writing = std::thread::Builder::new()
            .name("skein-checkpoint".to_owned())
            .spawn({
                let (waiting, path) = (waiting.clone(), path.to_owned());
                move || write_all(&waiting, &path, vehicle)
            })?;
        Ok(Self {
            vehicle,
            waiting,
            writing: Some(writing),
        })
    }

    pub(crate) fn write(&self, checkpoint: Checkpoint) {
        self.waiting.push(checkpoint);
    }
}

impl Drop for CheckpointWriter {
    fn drop(&mut self) {
        self.waiting.close();
        if self
            .writing
            .take()
            .is_some_and(|writing| writing.join().is_err())
        {
            tracing::error!(vehicle = %self.vehicle, "the thread of the checkpoints panicked: please report this with the log above");
        }
    }
}

fn write_all(waiting: &Queue<Checkpoint>, path: &Path, vehicle: Name) {
    let mut failing = false;
    while let Some(checkpoint) = waiting.pop() {
        match store(path, &checkpoint.encode(vehicle)) {
            Ok(()) => failing = false,
            // Said once, not every second.
            Err(error) if !failing => {
                failing = true;
                tracing::error!(checkpoint = %path.display(), %error, "checkpoints cannot be written: a restart will not resume");
            }
            Err(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};
    use skein_estimation::time::Stamp;
    use skein_estimation::transform::Transform;

    fn name() -> Name {
        Name::parse("v1").unwrap()
    }

    fn checkpoint(x: f64) -> Checkpoint {
        Checkpoint {
            boot: 1,
            taken: Stamp::from_nanos(1_800_000_000_000_000_000),
            world_from_body: Transform::new(UnitQuaternion::identity(), Vector3::new(x, 0.0, 0.0)),
        }
    }

    fn folder(test: &str) -> PathBuf {
        let name = format!("skein-checkpoint-{}-{test}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    #[test]
    fn a_newest_checkpoint_torn_at_any_byte_gives_way_to_the_previous_one() {
        let path = folder("torn").join("v1.checkpoint");
        assert_eq!(load(&path, name()), None);
        store(&path, &checkpoint(1.0).encode(name())).unwrap();
        assert_eq!(load(&path, name()), Some(checkpoint(1.0)));
        let newest = checkpoint(2.0).encode(name());
        store(&path, &newest).unwrap();
        assert_eq!(load(&path, name()), Some(checkpoint(2.0)));
        for length in 0..newest.len() {
            std::fs::write(&path, &newest[..length]).unwrap();
            assert_eq!(load(&path, name()), Some(checkpoint(1.0)), "{length} bytes");
        }
        for byte in 0..newest.len() {
            let mut flipped = newest;
            flipped[byte] ^= 0x40;
            std::fs::write(&path, flipped).unwrap();
            assert_eq!(load(&path, name()), Some(checkpoint(1.0)), "byte {byte}");
        }
        // Died between the two renames: there is no newest.
        std::fs::remove_file(&path).unwrap();
        assert_eq!(load(&path, name()), Some(checkpoint(1.0)));
    }

    #[test]
    fn what_waits_is_written_before_the_writer_ends() {
        let path = folder("writer").join("deep").join("v1.checkpoint");
        let writer = CheckpointWriter::start(&path, name()).unwrap();
        for k in 0..5 {
            writer.write(checkpoint(f64::from(k)));
        }
        drop(writer);
        assert_eq!(load(&path, name()), Some(checkpoint(4.0)));
    }
}
