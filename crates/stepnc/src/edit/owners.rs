//! What may go when a part goes: [`Removal`] follows the references of what is taken out and keeps whatever somebody else uses.
//!
//! In the AIM most things hang on their owner from outside: a property refers to its owner and not the other way round. So an instance
//! dies when all who refer to it are dead, or hang on it. Products, shapes and features are the design's and stay.

use super::{ChangeError, ProgramEdits};
use crate::aim::Aim;
use part21::Value;
use std::collections::{BTreeMap, BTreeSet};

/// What is to be taken out of a file.
pub(super) struct Removal<'f> {
    aim: Aim<'f>,
    dead: BTreeSet<u64>,
    /// References that are to be redirected: they hold nothing any more. User and used.
    unlinked: BTreeSet<(u64, u64)>,
    candidates: BTreeSet<u64>,
}

/// Entities that hang on what their n-th parameter (from 0) names, besides the relationships of methods.
const HANGING: [(&str, usize); 12] = [
    ("ACTION_PROPERTY", 2),
    ("MACHINING_PROCESS_PROPERTY", 2),
    ("ACTION_PROPERTY_REPRESENTATION", 2),
    ("RESOURCE_PROPERTY", 2),
    ("RESOURCE_PROPERTY_REPRESENTATION", 2),
    ("ACTION_RESOURCE_RELATIONSHIP", 2),
    ("PRODUCT_DEFINITION_PROCESS", 2),
    ("PROPERTY_PROCESS", 2),
    ("PROCESS_PRODUCT_ASSOCIATION", 3),
    ("PROCESS_PROPERTY_ASSOCIATION", 2),
    ("PROPERTY_DEFINITION", 2),
    ("PROPERTY_DEFINITION_REPRESENTATION", 0),
];

/// Relationships of methods, by the beginning of their names: the relating one owns them.
const OWN_RELATIONSHIPS: &str = "MACHINING_";

impl<'f> Removal<'f> {
    pub(super) fn new(aim: Aim<'f>) -> Self {
        Self {
            aim,
            dead: BTreeSet::new(),
            unlinked: BTreeSet::new(),
            candidates: BTreeSet::new(),
        }
    }

    /// Takes out an instance with all that hangs on it.
    pub(super) fn take_out(&mut self, id: u64) {
        let mut open = vec![id];
        while let Some(id) = open.pop() {
            if !self.dead.insert(id) {
                continue;
            }
            // An owner needs nothing of what hangs on it.
            if let Some(row) = self.aim.file.row(id) {
                let mut used = self.references(id);
                used.retain(|&used| self.bond(row, used) == Bond::Holds);
                self.candidates.extend(used);
            }
            for (user, bond) in self.users(id) {
                match bond {
                    Bond::Hangs => open.push(user),
                    Bond::Member if self.members_left(user).is_empty() => open.push(user),
                    Bond::Member | Bond::Holds => {}
                }
            }
        }
    }

    /// `user` is going to refer to something else instead of `used`.
    pub(super) fn unlink(&mut self, user: u64, used: u64) {
        self.unlinked.insert((user, used));
        self.candidates.insert(used);
    }

    /// Takes out what nobody uses any more.
    pub(super) fn settle(&mut self) {
        // What dies later puts what it referred to on the list again.
        while let Some(id) = self.candidates.pop_first() {
            if !self.dead.contains(&id) && is_the_programs(self.aim.keyword(id)) && self.holder(id).is_none() {
                self.take_out(id);
            }
        }
    }

    pub(super) fn takes(&self, id: u64) -> bool {
        self.dead.contains(&id)
    }

    /// True when these, and only these, are the newest instances of the file: taking them out leaves what was there before they came.
    pub(super) fn is_newest(&self) -> bool {
        let file = self.aim.file;
        let newest = file.rows().rev().take(self.dead.len()).map(|row| file.id(row));
        newest.eq(self.dead.iter().rev().copied())
    }

    /// Who is in the way of taking `id` out; 0 when it is another file that knows it by an anchor.
    pub(super) fn holder(&self, id: u64) -> Option<u64> {
        let anchors = self.aim.file.anchors();
        if anchors.iter().any(|anchor| anchor.value.reference() == Some(id)) {
            return Some(0);
        }
        self.users(id)
            .into_iter()
            .find(|(user, bond)| *bond == Bond::Holds && !self.dead.contains(user) && !self.unlinked.contains(&(*user, id)))
            .map(|(user, _)| user)
    }

    fn users(&self, id: u64) -> Vec<(u64, Bond)> {
        let file = self.aim.file;
        let bond = |&row: &part21::Row| (file.id(row), self.bond(row, id));
        file.inverse(id).iter().map(bond).collect()
    }

    fn bond(&self, user: part21::Row, used: u64) -> Bond {
        let file = self.aim.file;
        let keyword = file.keyword(user);
        let Ok(instance) = file.instance(user) else {
            return Bond::Holds;
        };
        let names = |n: usize| instance.argument(n).reference() == Some(used);
        let own_relationship = keyword.starts_with(OWN_RELATIONSHIPS) && keyword.ends_with("_RELATIONSHIP");
        if HANGING.iter().any(|(entity, n)| *entity == keyword && names(*n)) || (own_relationship && names(2)) {
            return Bond::Hangs;
        }
        // A place in the magazine is one tool's.
        if keyword == "REQUIREMENT_FOR_ACTION_RESOURCE" {
            return Bond::Hangs;
        }
        match member_list(keyword, &instance) {
            Some(n) if instance.argument(n).references().any(|member| member == used) => Bond::Member,
            _ => Bond::Holds,
        }
    }

    /// The members of a list that stay.
    fn members_left(&self, user: u64) -> Vec<u64> {
        let Ok(instance) = self.aim.instance(user) else {
            return Vec::new();
        };
        let Some(n) = member_list(self.aim.keyword(user), &instance) else {
            return Vec::new();
        };
        let members = instance.argument(n).references();
        members.filter(|member| !self.dead.contains(member)).collect()
    }

    fn references(&self, id: u64) -> Vec<u64> {
        fn collect(value: &Value, into: &mut Vec<u64>) {
            match value {
                Value::Reference(id) => into.push(*id),
                Value::List(items) | Value::Typed(_, items) => items.iter().for_each(|item| collect(item, into)),
                _ => {}
            }
        }
        let mut found = Vec::new();
        if let Ok(instance) = self.aim.instance(id) {
            let values = instance.records().iter().flat_map(|record| &record.arguments);
            values.for_each(|value| collect(value, &mut found));
        }
        found
    }
}

impl ProgramEdits<'_> {
    /// Does what a removal says: instances go, lists lose what went.
    pub(super) fn remove(&mut self, removal: &Removal) -> Result<(), ChangeError> {
        let aim = self.program.aim();
        let mut lists: BTreeMap<u64, Vec<u64>> = BTreeMap::new();
        for &id in &removal.dead {
            for (user, bond) in removal.users(id) {
                if bond == Bond::Member && !removal.dead.contains(&user) {
                    lists.insert(user, removal.members_left(user));
                }
            }
        }
        for (user, left) in lists {
            let (Some(row), Ok(instance)) = (aim.file.row(user), aim.instance(user)) else {
                continue;
            };
            if let Some(n) = member_list(aim.keyword(user), &instance) {
                let left: Vec<String> = left.iter().map(|id| format!("#{id}")).collect();
                self.edits.set_parameter(row, None, n, &format!("({})", left.join(",")))?;
            }
        }
        for &id in &removal.dead {
            if let Some(row) = aim.file.row(id) {
                self.edits.delete(row);
            }
        }
        Ok(())
    }
}

/// How an instance refers to another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Bond {
    /// It says something of it, and goes with it.
    Hangs,
    /// It has it in a list, and goes when the list is empty.
    Member,
    /// It needs it.
    Holds,
}

/// The parameter that lists what an assignment or a tool is for.
fn member_list(keyword: &str, instance: &part21::Instance) -> Option<usize> {
    let count = instance.records().first().map_or(0, |record| record.arguments.len());
    match keyword {
        "MACHINING_TOOL" => Some(2),
        _ if keyword.starts_with("APPLIED_") && keyword.ends_with("_ASSIGNMENT") => count.checked_sub(1),
        _ => None,
    }
}

/// False for what belongs to the design, or to the file as a whole.
fn is_the_programs(keyword: &str) -> bool {
    let kept = [
        "PRODUCT",
        "SHAPE_",
        "APPLICATION_",
        "MACHINING_PROJECT",
        "MACHINING_SETUP",
        "MACHINING_WORKPIECE",
        "ANCHOR",
    ];
    let feature = keyword.contains("FEATURE") && !keyword.starts_with("MACHINING_");
    !keyword.is_empty() && !feature && !kept.iter().any(|word| keyword.starts_with(word))
}
