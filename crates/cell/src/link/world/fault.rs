//! What goes wrong in a linked world.

use super::super::channel::Damage;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use units::Tick;

/// One thing that goes wrong with a link or at its ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkFault {
    /// The connection is gone for some cycles. `noticed`: both sides hear of it at once; otherwise only from the silence.
    Cut {
        /// When.
        at: Tick,
        /// Until somebody can connect again.
        ticks: u64,
        /// The sockets tell.
        noticed: bool,
    },
    /// Nothing arrives for some cycles, and then all of it.
    Stall {
        /// When.
        at: Tick,
        /// How long.
        ticks: u64,
    },
    /// The next bytes are damaged.
    Damaged {
        /// When.
        at: Tick,
        /// Towards the machine, or from it.
        to_machine: bool,
        /// How.
        damage: Damage,
    },
    /// The sender's process is killed, and started again with the same program.
    SenderKilled {
        /// When.
        at: Tick,
        /// Until it runs again.
        ticks: u64,
    },
    /// The controller's process is ended and started again. `orderly`: it stops on the path first; otherwise it is killed, and the drives
    /// stop by themselves.
    ControllerRestarted {
        /// When.
        at: Tick,
        /// Until it runs again.
        ticks: u64,
        /// It is asked to end.
        orderly: bool,
    },
    /// The realtime loop does not run for some cycles.
    LateTicks {
        /// When.
        at: Tick,
        /// How many.
        count: u64,
    },
}

impl LinkFault {
    /// One to three faults within the first `horizon` ticks, all decided by the seed.
    pub fn from_seed(seed: u64, horizon: Tick) -> Vec<LinkFault> {
        let mut dice = ChaCha8Rng::seed_from_u64(seed ^ 0x006c_696e_6b65_6400);
        let mut up_to = |n: u64| dice.next_u64() % n.max(1);
        (0..=up_to(3))
            .map(|_| {
                let at = Tick(1 + up_to(horizon.0));
                match up_to(8) {
                    0 => LinkFault::Cut {
                        at,
                        ticks: 1 + up_to(2_000),
                        noticed: up_to(2) == 0,
                    },
                    1 => LinkFault::Stall { at, ticks: 100 },
                    2 => LinkFault::Stall {
                        at,
                        ticks: 1 + up_to(1_000),
                    },
                    3 | 4 => LinkFault::Damaged {
                        at,
                        to_machine: up_to(4) > 0,
                        damage: match up_to(5) {
                            0 => Damage::Bit,
                            1 => Damage::Bytes,
                            2 => Damage::Twice,
                            3 => Damage::Missing,
                            _ => Damage::Swapped,
                        },
                    },
                    5 => LinkFault::SenderKilled {
                        at,
                        ticks: 1 + up_to(2_000),
                    },
                    6 => LinkFault::ControllerRestarted {
                        at,
                        ticks: 20 + up_to(2_000),
                        orderly: up_to(2) == 0,
                    },
                    _ => LinkFault::LateTicks {
                        at,
                        count: 1 + up_to(10),
                    },
                }
            })
            .collect()
    }
}
