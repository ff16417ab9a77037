//! Statements that decide: conditions, branches, loops and assignments, worked out when the stream comes to them. What only the machine
//! knows is asked for; where no machine is asked, what is assumed is said.

use super::*;

impl Walker<'_> {
    pub(super) fn condition(&self, executable: &Executable, condition: &Result<Expression, String>) -> Result<Expression, Fault> {
        match condition {
            Ok(expression) => Ok(substitute(expression, &self.run.variables)),
            Err(why) => Err(Fault::new(
                executable.id,
                "condition",
                format!("the condition of '{}' cannot be read: {why}", executable.name),
                EXPRESSION_REMEDY,
            )),
        }
    }

    pub(super) fn branch(&mut self, executable: &Executable, truth: bool) -> Result<(), Fault> {
        if let ExecutableKind::If { then, otherwise, .. } = &executable.kind {
            let chosen = if truth { then } else { otherwise };
            self.run.tasks.extend(chosen.map(Task::Execute));
        }
        Ok(())
    }

    /// Gives a variable its value, and asks the machine for what only it knows, one name after the other.
    pub(super) fn assign(&mut self, executable: &Executable, variable: &str, value: Expression) -> Outcome {
        if let Some(name) = first_name(&value) {
            let question = Question::Number(name.to_string());
            self.run.pending = Some(Pending::Assignment {
                executable: executable.id,
                asked: name.to_string(),
                value,
            });
            return Ok(Some(question));
        }
        match value.evaluate(&|_| None) {
            Ok(plan::Value::Number(number)) => {
                self.run.variables.insert(variable.to_string(), number);
                Ok(None)
            }
            Ok(plan::Value::Truth(truth)) => {
                // A boolean variable is kept as the number that it compares equal to.
                self.run.variables.insert(variable.to_string(), f64::from(u8::from(truth)));
                Ok(None)
            }
            Err(why) => Err(Fault::new(
                executable.id,
                "assignment",
                format!("'{}' has no value: {why}", executable.name),
                EXPRESSION_REMEDY,
            )),
        }
    }

    pub(super) fn again(&mut self, executable: &Executable, truth: bool) {
        if let ExecutableKind::While { body: Some(body), .. } = &executable.kind
            && truth
        {
            self.run.tasks.push(Task::Loop(executable.id));
            self.run.tasks.push(Task::Execute(*body));
        }
    }

    pub(super) fn answered(&mut self, pending: Pending, answer: Option<Answer>) -> Outcome {
        let (entity, question) = match &pending {
            Pending::OptionalStop(id) => (*id, Question::OptionalStop),
            Pending::Branch { executable, expression } | Pending::Loop { executable, expression } => {
                (*executable, Question::Condition(expression.clone()))
            }
            Pending::Assignment { executable, asked, .. } => (*executable, Question::Number(asked.clone())),
        };
        if let (Pending::Assignment { asked, value, .. }, Some(answer)) = (&pending, answer) {
            return self.answered_number(entity, asked, value, answer);
        }
        let truth = match answer {
            Some(Answer::Truth(truth)) => truth,
            Some(Answer::NotAsked) if question != Question::OptionalStop => {
                self.assume(
                    entity,
                    "answer-assumed",
                    "the condition is decided by the machine: here it is taken as not fulfilled",
                );
                false
            }
            None => {
                self.run.pending = Some(pending);
                return Ok(Some(question));
            }
            Some(_) => {
                return Err(Fault::new(
                    entity,
                    "no-answer",
                    "the machine cannot say whether the condition is true",
                    "check the names in the condition, or whether this machine has that sensor",
                ));
            }
        };
        let program = self.program;
        match pending {
            Pending::OptionalStop(id) => {
                if truth {
                    self.say(id, StepKind::Stop(StopKind::Optional));
                }
            }
            Pending::Branch { executable, .. } => {
                if let Some(executable) = program.executable(executable) {
                    self.branch(executable, truth)?;
                }
            }
            Pending::Loop { executable, .. } => {
                if let Some(executable) = program.executable(executable) {
                    self.again(executable, truth);
                }
            }
            Pending::Assignment { .. } => {}
        }
        Ok(None)
    }

    /// Says what is assumed where no machine was asked.
    pub(super) fn assume(&mut self, id: u64, code: &'static str, what: &str) {
        let fault = Fault::new(id, code, what, "look at what the program does for other values");
        self.program.note(&mut self.run.diagnostics, Severity::Warning, &fault);
    }

    pub(super) fn answered_number(&mut self, id: u64, asked: &str, value: &Expression, answer: Answer) -> Outcome {
        let program = self.program;
        let number = match answer {
            Answer::Number(Some(number)) if number.is_finite() => number,
            Answer::NotAsked => {
                self.assume(
                    id,
                    "value-assumed",
                    &format!("the value of '{asked}' is the machine's: here it is taken as 0"),
                );
                0.0
            }
            _ => {
                return Err(Fault::new(
                    id,
                    "no-answer",
                    format!("the machine has no value for '{asked}', which an assignment needs"),
                    "check the name, or whether this machine has that sensor",
                ));
            }
        };
        let Some(executable) = program.executable(id) else {
            return Ok(None);
        };
        let ExecutableKind::Assignment { variable, .. } = &executable.kind else {
            return Ok(None);
        };
        let value = substitute(value, &BTreeMap::from([(asked.to_string(), number)]));
        self.assign(executable, variable, value)
    }
}

pub(super) const EXPRESSION_REMEDY: &str = "use comparisons and arithmetic over numbers and named variables";

pub(super) fn writes_the_machine(executable: &Executable, variable: &str) -> Fault {
    Fault::new(
        executable.id,
        "T-07",
        format!("'{}' writes {variable}, which is the machine's", executable.name),
        "give a variable of the program",
    )
}

/// The expression with the variables that the program itself has given values.
pub(super) fn substitute(expression: &Expression, variables: &BTreeMap<String, f64>) -> Expression {
    let inside = |inner: &Expression| Box::new(substitute(inner, variables));
    match expression {
        Expression::Name(name) => match variables.get(name) {
            Some(&number) => Expression::Number(number, None),
            None => expression.clone(),
        },
        Expression::Not(inner) => Expression::Not(inside(inner)),
        Expression::Negate(inner) => Expression::Negate(inside(inner)),
        Expression::Binary(operator, left, right) => Expression::Binary(*operator, inside(left), inside(right)),
        Expression::Number(..) | Expression::Truth(_) => expression.clone(),
    }
}

/// True when an expression has this name in it.
pub(super) fn names(expression: &Expression, wanted: &str) -> bool {
    match expression {
        Expression::Name(name) => name == wanted,
        Expression::Not(inner) | Expression::Negate(inner) => names(inner, wanted),
        Expression::Binary(_, left, right) => names(left, wanted) || names(right, wanted),
        Expression::Number(..) | Expression::Truth(_) => false,
    }
}

/// The first name in an expression, from the left.
pub(super) fn first_name(expression: &Expression) -> Option<&str> {
    match expression {
        Expression::Name(name) => Some(name),
        Expression::Not(inner) | Expression::Negate(inner) => first_name(inner),
        Expression::Binary(_, left, right) => first_name(left).or_else(|| first_name(right)),
        Expression::Number(..) | Expression::Truth(_) => None,
    }
}

/// The value of a condition that needs nothing from the machine.
pub(super) fn truth(expression: &Expression) -> Option<bool> {
    match expression.evaluate(&|_| None) {
        Ok(plan::Value::Truth(truth)) => Some(truth),
        _ => None,
    }
}
