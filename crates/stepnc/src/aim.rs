//! The storage patterns of the AIM: properties, relationships and representations hang on their owner from outside.
//!
//! One attribute of a STEP-NC object is a chain of instances found by magic words; everything that knows those chains and not what
//! they mean is here. [`Fault`] is how the readers above say that a chain is broken.

use part21::{File, Instance, Row, Value};
use std::borrow::Cow;

/// Something wrong with an instance, before it is known how bad that is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    pub(crate) entity: u64,
    pub(crate) code: &'static str,
    pub(crate) message: String,
    pub(crate) remedy: &'static str,
}

impl Fault {
    pub(crate) fn new(entity: u64, code: &'static str, message: impl Into<String>, remedy: &'static str) -> Self {
        Self {
            entity,
            code,
            message: message.into(),
            remedy,
        }
    }
}

/// A representation: what a property says.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Representation {
    pub(crate) id: u64,
    pub(crate) name: String,
    pub(crate) items: Vec<u64>,
    pub(crate) context: Option<u64>,
}

/// A relationship in which an object is the relating side.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Relation {
    pub(crate) keyword: &'static str,
    pub(crate) id: u64,
    pub(crate) name: String,
    pub(crate) related: u64,
    pub(crate) sequence: Option<f64>,
}

/// Everything that hangs on one object.
#[derive(Clone, Debug, Default)]
pub(crate) struct Links {
    /// Name and representation of each property, and the property itself.
    pub(crate) properties: Vec<(String, u64, u64)>,
    pub(crate) relations: Vec<Relation>,
    /// Name and instance of each process definition (`'setup'`, `'machining'` ...).
    pub(crate) processes: Vec<(String, u64)>,
    /// Role and date.
    pub(crate) dates: Vec<(String, u64)>,
    /// Role and person: `operator`, `A. Miller`.
    pub(crate) people: Vec<(String, String)>,
    /// Status of approvals.
    pub(crate) approvals: Vec<String>,
}

/// The relationships that the reader follows. Their entities are subtypes of each other: the leaf decides.
pub(crate) const RELATIONSHIPS: [&str; 14] = [
    "MACHINING_PROCESS_SEQUENCE_RELATIONSHIP",
    "MACHINING_PROCESS_BRANCH_RELATIONSHIP",
    "MACHINING_PROCESS_CONCURRENT_RELATIONSHIP",
    "MACHINING_PROCESS_BODY_RELATIONSHIP",
    "MACHINING_OPERATION_RELATIONSHIP",
    "MACHINING_FEATURE_RELATIONSHIP",
    "MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP",
    "MACHINING_TECHNOLOGY_RELATIONSHIP",
    "MACHINING_FUNCTIONS_RELATIONSHIP",
    "MACHINING_TWIN_RELATIONSHIP",
    "MACHINING_USAGE_RELATIONSHIP",
    "MACHINING_FEATURE_SEQUENCE_RELATIONSHIP",
    "MACHINING_FINAL_FEATURE_RELATIONSHIP",
    "MACHINING_STRATEGY_RELATIONSHIP",
];

/// A file, asked in the words of the AIM.
#[derive(Clone, Copy)]
pub(crate) struct Aim<'f> {
    pub(crate) file: &'f File,
}

impl<'f> Aim<'f> {
    pub(crate) fn new(file: &'f File) -> Self {
        Self { file }
    }

    /// The parsed instance `#id`.
    pub(crate) fn instance(self, id: u64) -> Result<Instance<'f>, Fault> {
        let row = self.file.row(id).ok_or_else(|| {
            Fault::new(
                id,
                "missing-instance",
                format!("#{id} is referred to and not in the file"),
                "repair the file, or open the file it refers to",
            )
        })?;
        self.parsed(row)
    }

    pub(crate) fn parsed(self, row: Row) -> Result<Instance<'f>, Fault> {
        self.file.instance(row).map_err(|problem| {
            Fault::new(
                self.file.id(row),
                "unreadable-instance",
                problem.message,
                "repair this line of the file",
            )
        })
    }

    /// Is `#id` a `name`, or a complex instance with that part?
    pub(crate) fn is(self, id: u64, name: &str) -> bool {
        self.file.row(id).is_some_and(|row| self.file.is(row, name))
    }

    /// The keyword of `#id`; empty when it is not there.
    pub(crate) fn keyword(self, id: u64) -> &'f str {
        self.file.row(id).map_or("", |row| self.file.keyword(row))
    }

    /// The instances of an entity that name `id` as parameter `n`.
    pub(crate) fn users_by(self, id: u64, keyword: &'f str, n: usize) -> impl Iterator<Item = (u64, Instance<'f>)> + 'f {
        self.file.inverse(id).iter().filter_map(move |&row| {
            if !self.file.is(row, keyword) {
                return None;
            }
            let instance = self.file.instance(row).ok()?;
            (instance.argument(n).reference() == Some(id)).then(|| (self.file.id(row), instance))
        })
    }

    /// Collects all that hangs on `#id`.
    pub(crate) fn links(self, id: u64) -> Links {
        let mut links = Links::default();
        for &row in self.file.inverse(id) {
            let keyword = self.file.keyword(row);
            let user = self.file.id(row);
            match keyword {
                "ACTION_PROPERTY" | "MACHINING_PROCESS_PROPERTY" | "RESOURCE_PROPERTY" => {
                    let Ok(property) = self.file.instance(row) else { continue };
                    if property.argument(2).reference() != Some(id) {
                        continue;
                    }
                    let name = text(property.argument(0));
                    let chain = if keyword == "RESOURCE_PROPERTY" {
                        "RESOURCE_PROPERTY_REPRESENTATION"
                    } else {
                        "ACTION_PROPERTY_REPRESENTATION"
                    };
                    for (_, link) in self.users_by(user, chain, 2) {
                        if let Some(representation) = link.argument(3).reference() {
                            links.properties.push((name.to_string(), representation, user));
                        }
                    }
                }
                "PRODUCT_DEFINITION_PROCESS" => {
                    let Ok(process) = self.file.instance(row) else { continue };
                    if process.argument(2).reference() == Some(id) {
                        links.processes.push((text(process.argument(0)).to_string(), user));
                    }
                }
                "APPLIED_DATE_AND_TIME_ASSIGNMENT" => {
                    let Ok(assignment) = self.file.instance(row) else { continue };
                    let items = assignment.argument(2);
                    if let (Some(date), Some(role)) = (assignment.argument(0).reference(), assignment.argument(1).reference())
                        && items.references().any(|item| item == id)
                    {
                        let role = self
                            .instance(role)
                            .map(|role| text(role.argument(0)).to_string())
                            .unwrap_or_default();
                        links.dates.push((role, date));
                    }
                }
                "APPLIED_PERSON_AND_ORGANIZATION_ASSIGNMENT"
                | "APPLIED_PERSON_ASSIGNMENT"
                | "APPLIED_ORGANIZATION_ASSIGNMENT" => {
                    links.people.extend(self.person(row, id));
                }
                "APPLIED_APPROVAL_ASSIGNMENT" => links.approvals.extend(self.approval(row, id)),
                _ => {
                    let Some(&keyword) = RELATIONSHIPS.iter().find(|known| **known == keyword) else {
                        continue;
                    };
                    let Ok(relation) = self.file.instance(row) else { continue };
                    if let (Some(relating), Some(related)) = (relation.argument(2).reference(), relation.argument(3).reference())
                        && relating == id
                    {
                        links.relations.push(Relation {
                            keyword,
                            id: user,
                            name: text(relation.argument(0)).to_string(),
                            related,
                            sequence: relation.argument(4).number(),
                        });
                    }
                }
            }
        }
        links
    }

    /// Role and name of a person or organization that is assigned to `item`.
    fn person(self, assignment: Row, item: u64) -> Option<(String, String)> {
        let assignment = self.file.instance(assignment).ok()?;
        if !assignment.argument(2).references().any(|assigned| assigned == item) {
            return None;
        }
        let role = self.instance(assignment.argument(1).reference()?).ok()?;
        let who = self.instance(assignment.argument(0).reference()?).ok()?;
        let name_of = |id: u64| -> Option<String> {
            let who = self.instance(id).ok()?;
            // PERSON(id, last name, first name, ..) and ORGANIZATION(id, name, ..).
            let words: Vec<Cow<str>> = match self.keyword(id) {
                "PERSON" => [2, 1].map(|n| text(who.argument(n))).into(),
                _ => [1].map(|n| text(who.argument(n))).into(),
            };
            let words: Vec<&str> = words.iter().map(|word| word.trim()).filter(|word| !word.is_empty()).collect();
            match words.is_empty() {
                true => Some(text(who.argument(0)).into_owned()),
                false => Some(words.join(" ")),
            }
        };
        let names: Vec<String> = match who.part("PERSON_AND_ORGANIZATION") {
            Some(parts) => parts.iter().filter_map(Value::reference).filter_map(name_of).collect(),
            None => assignment.argument(0).reference().and_then(name_of).into_iter().collect(),
        };
        let names: Vec<String> = names.into_iter().filter(|name| !name.is_empty()).collect();
        Some((text(role.argument(0)).into_owned(), names.join(", ")))
    }

    /// Status of an approval that is assigned to `item`.
    fn approval(self, assignment: Row, item: u64) -> Option<String> {
        let assignment = self.file.instance(assignment).ok()?;
        if !assignment.argument(1).references().any(|assigned| assigned == item) {
            return None;
        }
        let approval = self.instance(assignment.argument(0).reference()?).ok()?;
        let status = approval.argument(0).reference().and_then(|status| self.instance(status).ok());
        let words = [
            status.map(|status| text(status.argument(0)).into_owned()),
            Some(text(approval.argument(1)).into_owned()),
        ];
        let words: Vec<String> = words.into_iter().flatten().filter(|word| !word.is_empty()).collect();
        Some(words.join(", "))
    }

    /// The arguments of an instance as its supertype `part` has them: those of a complex instance's part, or its own.
    ///
    /// Some writers spell out the supertypes of an executable or a tool: `(ACTION_METHOD('WS 1',..) MACHINING_WORKINGSTEP() ..)`.
    pub(crate) fn attributes<'i>(self, instance: &'i Instance<'f>, part: &str) -> &'i [Value<'f>] {
        match instance {
            Instance::Simple(record) => &record.arguments,
            Instance::Complex(_) => instance.part(part).unwrap_or(&[]),
        }
    }

    /// Name, items and context of a representation.
    pub(crate) fn representation(self, id: u64) -> Result<Representation, Fault> {
        let instance = self.instance(id)?;
        let arguments = match &instance {
            Instance::Simple(record) => record.arguments.as_slice(),
            Instance::Complex(_) => instance.part("REPRESENTATION").unwrap_or(&[]),
        };
        Ok(Representation {
            id,
            name: arguments.first().map_or(Cow::Borrowed(""), text).into_owned(),
            items: arguments.get(1).map(|items| items.references().collect()).unwrap_or_default(),
            context: arguments.get(2).and_then(Value::reference),
        })
    }

    /// The text of a descriptive item, or of any item that has one as its second parameter.
    pub(crate) fn description(self, item: u64) -> Option<String> {
        let instance = self.instance(item).ok()?;
        let arguments = match &instance {
            Instance::Simple(record) => record.arguments.as_slice(),
            Instance::Complex(_) => instance.part("DESCRIPTIVE_REPRESENTATION_ITEM")?,
        };
        arguments.iter().rev().find_map(Value::text).map(str::to_string)
    }

    /// The name of a representation item.
    pub(crate) fn item_name(self, item: u64) -> String {
        let Ok(instance) = self.instance(item) else {
            return String::new();
        };
        match &instance {
            Instance::Simple(_) => text(instance.argument(0)).into_owned(),
            Instance::Complex(_) => instance
                .part("REPRESENTATION_ITEM")
                .and_then(|arguments| arguments.first())
                .map_or(Cow::Borrowed(""), text)
                .into_owned(),
        }
    }
}

impl Links {
    /// The representation of the property `name`.
    pub(crate) fn property(&self, name: &str) -> Option<u64> {
        self.properties
            .iter()
            .find(|property| property.0 == name)
            .map(|property| property.1)
    }

    /// What the relationship `keyword` leads to.
    pub(crate) fn related(&self, keyword: &str) -> Option<u64> {
        self.relations
            .iter()
            .find(|relation| relation.keyword == keyword)
            .map(|relation| relation.related)
    }

    /// What the relationship `keyword` leads to, by sequence number; relationships without one keep their order at the end.
    pub(crate) fn in_sequence(&self, keyword: &str) -> Vec<u64> {
        let mut found: Vec<&Relation> = self.relations.iter().filter(|relation| relation.keyword == keyword).collect();
        found.sort_by(|a, b| {
            let place = |relation: &Relation| relation.sequence.unwrap_or(f64::INFINITY);
            place(a).total_cmp(&place(b))
        });
        found.into_iter().map(|relation| relation.related).collect()
    }
}

/// The text of a value; empty for `$` and everything that has none.
pub(crate) fn text<'v>(value: &'v Value<'_>) -> Cow<'v, str> {
    value.text().map_or(Cow::Borrowed(""), Cow::Borrowed)
}
