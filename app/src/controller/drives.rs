//! What moves the machine of a controller process: the simulator, or a card whose registers are a file.

use crate::failure::Failure;
use crate::shop;
use machine::{CyclicDrive, DriveOrders, Feedback, MachineParameters, Plant, Quality, RegisterCard};
use store::MachineFile;
use store::machine_file::Driver;
use store::register_file::RegisterFile;
use units::{Point, Tick};

/// The drives of a controller process.
pub enum Drives {
    /// Simulated iron.
    Simulated(Box<Plant>),
    /// A motion card.
    Card(Box<RegisterCard<RegisterFile>>),
}

impl Drives {
    /// Those that a machine file means.
    ///
    /// # Errors
    /// The registers of its card cannot be used.
    pub fn of(machine: &MachineFile, parameters: &MachineParameters, seed: u64) -> Result<Drives, Failure> {
        Ok(match &machine.driver {
            Driver::Sim => Drives::Simulated(Box::new(Plant::new(parameters, Point::ORIGIN, seed))),
            Driver::Card(path) => {
                let registers = RegisterFile::open(path)
                    .map_err(|e| Failure::machine(shop::failure(e).message.trim_start_matches("error: ")))?;
                Drives::Card(Box::new(RegisterCard::new(parameters, registers)))
            }
        })
    }

    /// What their measurements are worth.
    pub fn quality(&self) -> Quality {
        match self {
            Drives::Simulated(_) => Quality::Simulated,
            Drives::Card(_) => Quality::Good,
        }
    }
}

impl CyclicDrive for Drives {
    fn read(&mut self, now: Tick) -> Feedback {
        match self {
            Drives::Simulated(plant) => plant.read(now),
            Drives::Card(card) => card.read(now),
        }
    }

    fn order(&mut self, now: Tick, orders: &DriveOrders) {
        match self {
            Drives::Simulated(plant) => plant.order(now, orders),
            Drives::Card(card) => card.order(now, orders),
        }
    }
}
