//! What is read from small texts, what is said about broken ones, and what changes when something is changed.

use expect_test::{Expect, expect};
use part21::{Edits, ExternalName, File, Instance, ReadError, Value};
use proptest::prelude::*;

/// A file with `data` as its only DATA section.
fn with_data(data: &str) -> String {
    format!(
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('x','',(''),(''),'','','');\n\
         FILE_SCHEMA(('INTEGRATED_CNC_SCHEMA {{ 1 0 10303 238 }}'));\nENDSEC;\nDATA;\n{data}\nENDSEC;\nEND-ISO-10303-21;\n"
    )
}

fn read(text: &str) -> File {
    File::read(text.as_bytes().to_vec()).expect("a Part 21 file")
}

/// All that the index holds, as text.
fn outline(file: &File) -> String {
    let mut out = String::new();
    for row in file.rows() {
        let users: Vec<u64> = file.users(row).iter().map(|&user| file.id(user)).collect();
        let values = match file.instance(row) {
            Ok(Instance::Simple(record)) => format!("{:?}", record.arguments.iter().map(Value::to_string).collect::<Vec<_>>()),
            Ok(Instance::Complex(records)) => format!("{} parts", records.len()),
            Err(problem) => problem.to_string(),
        };
        out += &format!("#{} {} {values} used by {users:?}\n", file.id(row), file.keyword(row));
    }
    for problem in file.problems() {
        out += &format!("{problem}\n");
    }
    out
}

#[track_caller]
fn check(data: &str, expected: Expect) {
    expected.assert_eq(&outline(&read(&with_data(data))));
}

#[test]
fn values_of_all_kinds_are_read() {
    check(
        "#1=A('it''s; a #2=(trap)',(0.,-1.5E-003,1.E+10),.T.,\"0A1F\",$,*,#2,LENGTH_MEASURE(2.5),-7);\n\
         #2 = ( C() B ( #1, /* inner ; ' */ 'x' ) ) ;\n#999999999999=!VENDOR(#2,#2);",
        expect![[r##"
            #1 A ["'it''s; a #2=(trap)'", "(0.,-0.0015,10000000000.)", ".T.", "\"0A1F\"", "$", "*", "#2", "LENGTH_MEASURE(2.5)", "-7"] used by [2]
            #2 C B 2 parts used by [1, 999999999999]
            #999999999999 !VENDOR ["#2", "#2"] used by []
        "##]],
    );
}

#[test]
fn instances_in_any_order_are_found_and_the_first_of_two_equals_holds() {
    check(
        "#30=A(#10,#20);\n#10=B(#30);\n#20=C(#30,#10);\n#10=D(#30);",
        expect![[r##"
            #10 B ["#30"] used by [20, 30]
            #20 C ["#30", "#10"] used by [30]
            #30 A ["#10", "#20"] used by [10, 20]
            line 11, column 1: #10 is defined twice: the first definition holds [duplicate-identifier]
        "##]],
    );
}

#[test]
fn a_broken_instance_is_named_and_the_next_one_is_read() {
    check(
        "#1=A('never closed,(0.));\n#2=B('ok');\n#3=C((1.,2.);\n#4=D(1)\n#5=E(2);\n#6;\n#7=F(#1);\n#8=G(12..3);",
        expect![[r##"
            #2 B ["'ok'"] used by []
            #5 E ["2"] used by []
            #7 F ["#1"] used by []
            #8 G line 15, column 6: #8: "12..3" is not a number [number] used by []
            line 8, column 6: a string in #1 is not closed: the instance is skipped [unterminated-string]
            line 10, column 13: the parentheses of #3 do not pair: the instance is skipped [parentheses]
            line 12, column 1: instance #4 is not closed: it is skipped [missing-semicolon]
            line 13, column 3: = is missing behind #6 [syntax]
            line 14, column 1: #7 refers to #1, which the file does not hold; 1 such references [missing-instance]
        "##]],
    );
}

#[test]
fn a_truncated_file_keeps_what_is_whole() {
    let text = with_data("#1=A();\n#2=B((#1,#");
    let cut = &text[..text.len() - "\nENDSEC;\nEND-ISO-10303-21;\n".len()];
    expect![[r#"
        #1 A [] used by []
        line 9, column 1: the file ends inside instance #2 [truncated-instance]
        line 9, column 11: the file ends inside a section: its end is missing, so instances may be [truncated]
    "#]]
    .assert_eq(&outline(&read(cut)));
}

#[test]
fn what_is_no_part_21_file_is_refused_with_the_reason() {
    let refuse = |bytes: &[u8]| File::read(bytes.to_vec()).err();
    assert_eq!(refuse(b""), Some(ReadError::Empty));
    assert!(matches!(refuse(b"\x7fELF\0\0"), Some(ReadError::Binary { byte: 0, .. })));
    let error = refuse(b"%PDF-1.7 text").expect("not STEP");
    assert_eq!(
        error.to_string(),
        "this is not a STEP file: it begins with \"%PDF-1.7 text\" instead of ISO-10303-21;"
    );
}

#[test]
fn edition_3_sections_are_read() {
    let file = read(
        "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('A'));\nENDSEC;\nANCHOR;\n<origin>=#1 {note:'x;y'};\n<list>=(#1,2.5);\nENDSEC;\n\
         REFERENCE;\n#100=<other.p21#main>;\n@7=<#limit>;\nENDSEC;\nDATA('first',('S'));\n#1=A(#100);\nENDSEC;\nDATA;\n#2=B(@7);\nENDSEC;\n\
         END-ISO-10303-21;\nSIGNATURE;\nMIIB\nENDSEC;\n",
    );
    assert_eq!(file.problems(), []);
    assert_eq!(file.external(100), Some("other.p21#main"));
    assert_eq!(file.externals()[1].name, ExternalName::Value(7));
    assert_eq!(file.anchors()[0].name, "origin");
    assert_eq!(file.anchors()[1].value.to_string(), "(#1,2.5)");
    assert_eq!(file.data_sections().len(), 2);
    assert_eq!(file.highest_id(), 100);
    assert!(file.is_signed());

    let mut edits = Edits::new(&file);
    assert_eq!(edits.append("C(#2)"), Ok(101));
    let saved = edits.save().expect("it has a DATA section");
    let text = String::from_utf8(saved.bytes).expect("ASCII");
    assert!(
        text.contains("#2=B(@7);\n#101=C(#2);\nENDSEC;\nEND-ISO-10303-21;\n"),
        "{text}"
    );
    assert!(!text.contains("SIGNATURE") && saved.notices.len() == 1);
}

#[test]
fn a_changed_file_differs_only_where_it_was_changed() {
    let text = with_data("#1=A('keep /*');  /* keep */\n#2 = B( #1 );\n#3=C();\n#4=D();");
    let file = read(&text);
    let row = |id| file.row(id).expect("it is there");
    let mut edits = Edits::new(&file);
    edits.replace(row(2), "B(#1,$)").expect("well formed");
    edits.delete(row(3));
    edits
        .set_header("FILE_NAME", 1, "'2026-11-21T21:00:00Z'")
        .expect("it has a time stamp");
    assert!(edits.append("E(NaN)").is_err() && edits.append("E();F()").is_err() && edits.append("E('x").is_err());
    let expected = text
        .replace("#2 = B( #1 );", "#2=B(#1,$);")
        .replace("#3=C();\n", "")
        .replace("FILE_NAME('x','',", "FILE_NAME('x','2026-11-21T21:00:00Z',");
    assert_eq!(String::from_utf8(edits.save().expect("fine").bytes), Ok(expected));
}

/// Everything that can be asked of a file, for the sake of not panicking.
fn ask_everything(bytes: &[u8]) {
    let Ok(file) = File::read(bytes.to_vec()) else { return };
    for row in file.rows() {
        let _ = file.instance(row).map(|instance| format!("{instance:?}"));
        assert!(file.span(row).end <= bytes.len());
        file.users(row);
    }
    for problem in file.problems() {
        assert!(problem.offset as usize <= bytes.len());
    }
    assert_eq!(Edits::new(&file).save().expect("nothing to refuse").bytes, bytes);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_mutation_panics_and_an_unchanged_save_is_the_same_bytes(
        changes in prop::collection::vec((any::<prop::sample::Index>(), prop::sample::select(b"'#;()/*<>=@$.,\\\"0\n E\xff".to_vec())), 0..6),
        cut in any::<prop::sample::Index>(),
        truncate in any::<bool>(),
    ) {
        let mut bytes = with_data(
            "#1=A('it''s',(0.,-1.5E-3),.T.,\"0A\",$,*,#2);\n#2=(C() B(#1,'\\X2\\00FC\\X0\\'));\n/* c */\n#99999999999=!V(#2,((())));\n#3=D(#1,#1);",
        ).into_bytes();
        for (place, byte) in changes {
            let place = place.index(bytes.len());
            bytes[place] = byte;
        }
        if truncate {
            bytes.truncate(cut.index(bytes.len()));
        }
        ask_everything(&bytes);
    }
}
