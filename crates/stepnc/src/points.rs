//! Points that a file names: polylines and sets of points, for functions that record where the tool passes them.

use crate::aim::Aim;
use crate::model::Program;
use part21::{Instance, Value};
use std::collections::BTreeMap;

/// Most points of one piece of geometry.
const MOST: usize = 100_000;
/// A set may hold polylines, and those points.
const DEEPEST: u32 = 4;

impl Program {
    /// Points of polylines and of sets of points, mm, by the number of their entity and by their anchor. A curve of another kind has no
    /// points of its own, and geometry whose unit the file does not say is left out.
    pub fn named_points(&self) -> BTreeMap<String, Vec<[f64; 3]>> {
        let aim = self.aim();
        let mut all = BTreeMap::new();
        let mut add = |name: String, id: u64| {
            let mut found = Vec::new();
            collect(aim, id, 0, &mut found);
            if let Some(scale) = millimetres(aim, id)
                && !found.is_empty()
            {
                all.insert(name, found.iter().map(|point: &[f64; 3]| point.map(|v| v * scale)).collect());
            }
        };
        for keyword in ["POLYLINE", "GEOMETRIC_SET", "GEOMETRIC_CURVE_SET"] {
            for row in aim.file.by_keyword(keyword) {
                let id = aim.file.id(row);
                add(id.to_string(), id);
            }
        }
        for anchor in aim.file.anchors() {
            if let Some(id) = anchor.value.reference() {
                add(anchor.name.clone(), id);
            }
        }
        all
    }
}

fn collect(aim: Aim, id: u64, depth: u32, found: &mut Vec<[f64; 3]>) {
    let Ok(instance) = aim.instance(id) else { return };
    if depth > DEEPEST || found.len() >= MOST {
        return;
    }
    if let Some(arguments) = instance.part("CARTESIAN_POINT") {
        let numbers: Vec<f64> = arguments.iter().flat_map(Value::items).filter_map(Value::number).collect();
        if let [x, y, rest @ ..] = numbers.as_slice() {
            found.push([*x, *y, rest.first().copied().unwrap_or(0.0)]);
        }
        return;
    }
    for argument in arguments(&instance) {
        for id in argument.reference().into_iter().chain(argument.references()) {
            collect(aim, id, depth + 1, found);
        }
    }
}

fn arguments<'i, 'f>(instance: &'i Instance<'f>) -> impl Iterator<Item = &'i Value<'f>> {
    instance.records().iter().flat_map(|record| &record.arguments)
}

/// The unit of a piece of geometry: that of the representation it stands in, else the only one that the file has.
fn millimetres(aim: Aim, id: u64) -> Option<f64> {
    let within = aim.file.inverse(id).iter().find_map(|row| {
        let context = aim.representation(aim.file.id(*row)).ok()?.context?;
        Some(aim.context_units(context).ok()?.millimetres)
    });
    within.or_else(|| {
        let contexts = aim.file.by_name(|name| name.contains("GLOBAL_UNIT_ASSIGNED_CONTEXT"));
        let mut scales = contexts.filter_map(|row| Some(aim.context_units(aim.file.id(row)).ok()?.millimetres));
        let first = scales.next()?;
        scales.all(|scale| scale == first).then_some(first)
    })
}
