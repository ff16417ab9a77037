//! Where the paths of a program lie in the machine.

use super::*;

impl Walker<'_> {
    /// The frame of the paths at this place of the tree, with its name and whether its origin was assumed.
    ///
    /// The remark about it, if any, is for when the frame is said.
    pub(super) fn frame(&self) -> Result<(FrameChange, Option<(Severity, Fault)>), Fault> {
        let program = self.program;
        let around: Vec<&Executable> = self.run.scopes.iter().filter_map(|&id| program.executable(id)).collect();
        let setup = around.iter().rev().find_map(|executable| executable.setup.as_ref());
        let name = setup.map(|setup| setup.name.clone()).unwrap_or_default();
        let table = self.options.tables.work_offsets.get(&name).copied();
        let in_file = setup.and_then(|setup| setup.machine_from_setup);
        let entity = setup.map(|setup| setup.id).or(self.run.scopes.first().copied()).unwrap_or(0);
        let remark = |message: String, remedy| Fault::new(entity, "setup-origin", message, remedy);
        let (no_origin, no_origin_remedy) = match setup {
            Some(_) => (
                format!("the set-up '{name}' has no origin"),
                "enter a work offset of this name",
            ),
            None => (
                "the program has no set-up that says where its paths lie in the machine".to_string(),
                "give its workplan a set-up with an origin",
            ),
        };
        let (origin, found) = match (table, in_file, self.options.tables.missing) {
            (Some(table), Some(in_file), _) if table != in_file => {
                let message = format!("the work offset '{name}' of the machine is used, not the set-up's origin in the file");
                (table, Some((Severity::Remark, remark(message, ""))))
            }
            (Some(table), _, _) => (table, None),
            (None, Some(in_file), _) => (in_file, None),
            // A part without a place is assumed to be clamped where G54 says, as a machinist would; without one, at home.
            (None, None, Missing::Assume) => {
                let clamped = self.options.tables.work_offsets.get("G54").copied();
                let assumed = if clamped.is_some() {
                    "G54 of the machine"
                } else {
                    "the machine's origin"
                };
                let fault = remark(format!("{no_origin}: {assumed} is assumed"), no_origin_remedy);
                (clamped.unwrap_or(Transform::IDENTITY), Some((Severity::Warning, fault)))
            }
            (None, None, Missing::Fail) => {
                return Err(remark(
                    format!("the set-up '{name}' has no origin"),
                    "enter a work offset of this name",
                ));
            }
        };
        let placement = setup.and_then(|setup| setup.setup_from_part);
        let orientations = around.iter().filter_map(|executable| executable.orientation.as_ref());
        let change = FrameChange {
            name,
            machine_from_setup: machine_from_path(origin, placement, orientations, self.options.path_frame),
            assumed: table.is_none() && in_file.is_none(),
        };
        Ok((change, found))
    }
}

/// The one place where frames are put together; see the module's text.
fn machine_from_path<'o>(
    machine_from_setup: Transform<Machine, Setup>,
    setup_from_part: Option<Transform<Setup, units::Part>>,
    orientations: impl Iterator<Item = &'o Transform<Setup, Setup>>,
    reading: PathFrame,
) -> Transform<Machine, Setup> {
    let mut frame = machine_from_setup;
    if let (PathFrame::Workpiece, Some(placement)) = (reading, setup_from_part) {
        let mut moved: Transform<Setup, Setup> = Transform::IDENTITY;
        (moved.rotation, moved.origin) = (placement.rotation, placement.origin);
        frame = frame * moved;
    }
    orientations.fold(frame, |frame, orientation| frame * *orientation)
}
