//! As much of an EXPRESS schema as a file can be held against without running its rules.

use part21::{File, Instance, Record, Value};
use std::collections::{BTreeMap, BTreeSet};

/// Entities and types of a schema, all names in lower case.
pub struct Schema {
    entities: BTreeMap<String, Entity>,
    types: BTreeMap<String, String>,
}

struct Entity {
    supertypes: Vec<String>,
    /// Name, whether it may be missing, type.
    attributes: Vec<(String, bool, String)>,
    /// Inherited attributes that are derived here: entity and name.
    derived: Vec<(String, String)>,
}

impl Schema {
    pub fn read(text: &str) -> Schema {
        let text = without_comments(text).to_lowercase();
        let mut schema = Schema {
            entities: BTreeMap::new(),
            types: BTreeMap::new(),
        };
        let words: Vec<&str> = text.split_whitespace().collect();
        let mut at = 0;
        while at < words.len() {
            match words[at] {
                "type" if words.get(at + 2) == Some(&"=") => {
                    let end = (at..words.len())
                        .find(|&n| words[n].starts_with("end_type"))
                        .unwrap_or(words.len());
                    let rule = (at..end).find(|&n| words[n] == "where").unwrap_or(end);
                    let body = words[at + 3..rule].join(" ");
                    schema
                        .types
                        .insert(words[at + 1].into(), body.trim_end_matches([';', ' ']).into());
                    at = end;
                }
                "entity" => {
                    let end = (at..words.len())
                        .find(|&n| words[n].starts_with("end_entity"))
                        .unwrap_or(words.len());
                    let name = words[at + 1].trim_end_matches(';').to_string();
                    schema.entities.insert(name, Entity::read(&words[at + 1..end]));
                    at = end;
                }
                _ => {}
            }
            at += 1;
        }
        assert!(schema.entities.len() > 100, "this is no long form");
        schema
    }

    /// What does not fit, one line a fault.
    pub fn faults(&self, file: &File) -> Vec<String> {
        let mut found = Vec::new();
        for row in file.rows() {
            let id = file.id(row);
            let instance = match file.instance(row) {
                Ok(instance) => instance,
                Err(problem) => {
                    found.push(format!("#{id}: {}", problem.message));
                    continue;
                }
            };
            let mut say = |text: String| found.push(format!("#{id} {}: {text}", file.keyword(row)));
            match &instance {
                Instance::Simple(record) => {
                    let name = record.keyword.to_lowercase();
                    if !self.entities.contains_key(&name) {
                        say("the schema has no such entity".into());
                        continue;
                    }
                    let mut attributes = Vec::new();
                    for entity in self.order(&name) {
                        attributes.extend(
                            self.entities[&entity]
                                .attributes
                                .iter()
                                .map(|attribute| (entity.clone(), attribute)),
                        );
                    }
                    self.record(file, record, &attributes, &self.derived(&[name]), &mut say);
                }
                Instance::Complex(records) => {
                    let names: Vec<String> = records.iter().map(|record| record.keyword.to_lowercase()).collect();
                    let present: BTreeSet<&String> = names.iter().collect();
                    if !names.is_sorted() {
                        say("its parts are not in alphabetical order".into());
                    }
                    for (name, record) in names.iter().zip(records) {
                        let Some(entity) = self.entities.get(name) else {
                            say(format!("the schema has no {name}"));
                            continue;
                        };
                        for missing in self.order(name).iter().filter(|super_type| !present.contains(super_type)) {
                            say(format!("{name} without its supertype {missing}"));
                        }
                        let attributes: Vec<_> = entity.attributes.iter().map(|attribute| (name.clone(), attribute)).collect();
                        self.record(file, record, &attributes, &self.derived(&names), &mut say);
                    }
                }
            }
        }
        found
    }

    fn derived(&self, names: &[String]) -> Vec<(String, String)> {
        let all = names.iter().flat_map(|name| self.order(name));
        all.flat_map(|entity| {
            self.entities
                .get(&entity)
                .map(|entity| entity.derived.clone())
                .unwrap_or_default()
        })
        .collect()
    }

    fn record(
        &self,
        file: &File,
        record: &Record,
        attributes: &[(String, &(String, bool, String))],
        derived: &[(String, String)],
        say: &mut impl FnMut(String),
    ) {
        if record.arguments.len() != attributes.len() {
            say(format!("{} arguments, {} are due", record.arguments.len(), attributes.len()));
            return;
        }
        for (value, (entity, (name, optional, kind))) in record.arguments.iter().zip(attributes) {
            let is_derived = derived.iter().any(|(of, what)| of == entity && what == name);
            match value {
                Value::Derived if is_derived => {}
                Value::Unset if *optional => {}
                _ if is_derived => say(format!("{name} is derived and needs *")),
                _ => {
                    if let Err(why) = self.value(file, value, kind, 0) {
                        say(format!("{name}: {why}"));
                    }
                }
            }
        }
    }

    /// A value against a type.
    fn value(&self, file: &File, value: &Value, kind: &str, depth: u32) -> Result<(), String> {
        let kind = kind.trim();
        let wrong = || Err(format!("{value} is no {kind}"));
        if depth > 40 {
            return wrong();
        }
        if let Some((low, high, element)) = aggregate(kind) {
            let Value::List(items) = value else { return wrong() };
            if items.len() < low || high.is_some_and(|high| items.len() > high) {
                return Err(format!("{} items in {kind}", items.len()));
            }
            return items.iter().try_for_each(|item| self.value(file, item, element, depth + 1));
        }
        let base = kind.split(['(', ' ']).next().unwrap_or(kind);
        let simple = match (base, value) {
            ("string", Value::String(_)) | ("integer", Value::Integer(_)) | ("binary", Value::Binary(_)) => Some(true),
            ("real", Value::Real(_)) | ("number", Value::Real(_) | Value::Integer(_)) => Some(true),
            ("boolean", Value::Enumeration(word)) => Some(["T", "F"].contains(&&**word)),
            ("logical", Value::Enumeration(word)) => Some(["T", "F", "U"].contains(&&**word)),
            ("string" | "integer" | "real" | "number" | "boolean" | "logical" | "binary", _) => Some(false),
            _ => None,
        };
        if let Some(fits) = simple {
            return if fits { Ok(()) } else { wrong() };
        }
        if self.entities.contains_key(kind) {
            let Value::Reference(id) = value else { return wrong() };
            return self.reference(file, *id, &BTreeSet::from([kind.to_string()]));
        }
        let Some(body) = self.types.get(kind) else { return wrong() };
        if let Some(words) = list_behind(body, "enumeration") {
            return match value {
                Value::Enumeration(word) if words.contains(&word.to_lowercase()) => Ok(()),
                _ => wrong(),
            };
        }
        if body.contains("select") {
            let mut leaves = BTreeSet::new();
            self.expand(kind, &mut leaves);
            return match value {
                Value::Reference(id) => self.reference(file, *id, &leaves),
                Value::Typed(name, inside) => {
                    let name = name.to_lowercase();
                    if !leaves.contains(&name) {
                        return wrong();
                    }
                    let [inside] = inside.as_slice() else { return wrong() };
                    let under = self.types.get(&name).cloned().unwrap_or_default();
                    self.value(file, inside, &under, depth + 1)
                }
                _ => wrong(),
            };
        }
        let body = body.clone();
        match value {
            Value::Typed(name, inside) if name.eq_ignore_ascii_case(kind) && inside.len() == 1 => {
                self.value(file, &inside[0], &body, depth + 1)
            }
            _ => self.value(file, value, &body, depth + 1),
        }
    }

    fn reference(&self, file: &File, id: u64, kinds: &BTreeSet<String>) -> Result<(), String> {
        let Some(row) = file.row(id) else {
            return match file.external(id) {
                Some(_) => Ok(()),
                None => Err(format!("#{id} is not in the file")),
            };
        };
        let parts = file.keyword(row).to_lowercase();
        let fits = |part: &str| self.entities.contains_key(part) && self.order(part).iter().any(|name| kinds.contains(name));
        if parts.split(' ').any(fits) {
            return Ok(());
        }
        let few: Vec<&String> = kinds.iter().take(4).collect();
        Err(format!("#{id} is a {parts}, not one of {few:?}"))
    }

    /// All supertypes in the order in which their attributes stand, the entity itself last.
    fn order(&self, name: &str) -> Vec<String> {
        fn visit(schema: &Schema, name: &str, into: &mut Vec<String>) {
            for above in schema
                .entities
                .get(name)
                .map(|entity| &entity.supertypes[..])
                .unwrap_or_default()
            {
                visit(schema, above, into);
            }
            if !into.iter().any(|known| known == name) {
                into.push(name.to_string());
            }
        }
        let mut order = Vec::new();
        visit(self, name, &mut order);
        order
    }

    /// What a select may be in the end.
    fn expand(&self, name: &str, into: &mut BTreeSet<String>) {
        if !into.insert(name.to_string()) {
            return;
        }
        if let Some(body) = self.types.get(name)
            && let Some(words) = list_behind(body, "select")
        {
            words.iter().for_each(|word| self.expand(word, into));
        }
    }
}

impl Entity {
    fn read(words: &[&str]) -> Entity {
        // Inverse attributes and rules are no part of a file; `unique` opens a clause only where a label follows.
        let body = words.join(" ");
        let cut = [" inverse ", " where ", " unique ur", " unique un"]
            .iter()
            .filter_map(|word| body.find(word))
            .min();
        let body = &body[..cut.unwrap_or(body.len())];
        let (body, derive) = body.split_once(" derive ").unwrap_or((body, ""));
        let (head, attributes) = body.split_once(';').unwrap_or((body, ""));
        let supertypes = head.find("subtype of (").map(|at| {
            let list = &head[at + 12..];
            let list = &list[..list.find(')').unwrap_or(list.len())];
            list.split(',').map(|name| name.trim().to_string()).collect()
        });
        let mut all = Vec::new();
        for attribute in attributes.split(';') {
            let Some((names, kind)) = attribute.split_once(':') else {
                continue;
            };
            // A redeclared attribute stands where its supertype has it.
            if names.contains("self\\") {
                continue;
            }
            let kind = kind.trim();
            let (optional, kind) = kind.strip_prefix("optional ").map_or((false, kind), |kind| (true, kind));
            for name in names.split(',') {
                all.push((name.trim().to_string(), optional, kind.trim().to_string()));
            }
        }
        let derived = derive
            .split(';')
            .filter_map(|line| line.trim().strip_prefix("self\\"))
            .filter_map(|line| line.split(':').next()?.trim().split_once('.'))
            .map(|(entity, name)| (entity.trim().to_string(), name.trim().to_string()))
            .collect();
        Entity {
            supertypes: supertypes.unwrap_or_default(),
            attributes: all,
            derived,
        }
    }
}

fn without_comments(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find("(*") {
        out.push_str(&rest[..at]);
        rest = rest[at..].find("*)").map_or("", |end| &rest[at + end + 2..]);
    }
    out.push_str(rest);
    let lines = out.lines().map(|line| line.find("--").map_or(line, |at| &line[..at]));
    lines.collect::<Vec<_>>().join("\n")
}

/// Bounds and element of `list [1:?] of unique point`.
fn aggregate(kind: &str) -> Option<(usize, Option<usize>, &str)> {
    let kinds = ["list", "set", "bag", "array"];
    kinds.iter().find(|word| kind.starts_with(&format!("{word} ")))?;
    let (head, element) = kind.split_once(" of ")?;
    let element = element.strip_prefix("unique ").unwrap_or(element);
    let bounds = head
        .split_once('[')
        .and_then(|(_, bounds)| bounds.trim_end_matches([']', ' ']).split_once(':'));
    let (low, high) = bounds.map_or((0, None), |(low, high)| {
        (
            low.trim().parse().unwrap_or(0),
            high.trim().trim_end_matches(']').parse().ok(),
        )
    });
    Some((low, high, element))
}

/// The names in `select (a, b)` and `enumeration of (a, b)`.
fn list_behind(body: &str, word: &str) -> Option<Vec<String>> {
    if !body.contains(word) {
        return None;
    }
    let list = &body[body.find('(')? + 1..body.rfind(')')?];
    Some(list.split(',').map(|name| name.trim().to_string()).collect())
}
