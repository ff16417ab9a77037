//! Security classifications that say the edit access level of parts.

use super::{ChangeError, ProgramEdits};
use crate::levels::{CLASSIFICATION, assignments};
use part21::text::encode;
use std::collections::BTreeMap;

impl ProgramEdits<'_> {
    /// Says the edit access level of parts as a classification of each, or takes it away with `None`. Parts of one level share one
    /// assignment; what nobody uses any more goes.
    ///
    /// # Errors
    /// The file's text cannot be changed so.
    pub fn classify(&mut self, parts: &[(u64, Option<u8>)]) -> Result<(), ChangeError> {
        let moved: BTreeMap<u64, Option<u8>> = parts.iter().copied().collect();
        let mut wanted: BTreeMap<u8, Vec<u64>> = BTreeMap::new();
        for (id, level) in &moved {
            if let Some(level) = level {
                wanted.entry(*level).or_default().push(*id);
            }
        }
        let known = assignments(self.program);
        let file = self.program.file();
        for assignment in &known {
            let mut items: Vec<u64> = assignment.items.clone();
            items.retain(|id| !moved.contains_key(id));
            items.extend(wanted.remove(&assignment.level).unwrap_or_default());
            if items == assignment.items {
                continue;
            }
            if !items.is_empty() {
                let list: Vec<String> = items.iter().map(|id| format!("#{id}")).collect();
                self.set(assignment.id, 1, &format!("({})", list.join(",")))?;
                continue;
            }
            // The assignment, what it assigns, and its level, as far as they are its alone.
            let mut user = assignment.id;
            self.take_row(user);
            for id in [assignment.classification, assignment.level_instance] {
                let others = file.inverse(id).iter().filter(|&&row| file.id(row) != user).count();
                let anchored = file.anchors().iter().any(|anchor| anchor.value.reference() == Some(id));
                if others > 0 || anchored {
                    break;
                }
                self.take_row(id);
                user = id;
            }
        }
        for (level, items) in wanted {
            let name = self.edits.append(&format!("SECURITY_CLASSIFICATION_LEVEL('{level}')"))?;
            let said = self
                .edits
                .append(&format!("SECURITY_CLASSIFICATION({},'',#{name})", encode(CLASSIFICATION)))?;
            let list: Vec<String> = items.iter().map(|id| format!("#{id}")).collect();
            self.edits.append(&format!(
                "APPLIED_SECURITY_CLASSIFICATION_ASSIGNMENT(#{said},({}))",
                list.join(",")
            ))?;
        }
        Ok(())
    }

    fn take_row(&mut self, id: u64) {
        if let Some(row) = self.program.file().row(id) {
            self.edits.delete(row);
        }
    }
}
