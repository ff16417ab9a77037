//! Files as no writer should make them and some do, and files as only an attacker makes them: what is read, and that reading ends.

use part21::{Edits, ExternalName, File, Instance, Value};

fn with_data(data: &str) -> String {
    format!("ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('S'));\nENDSEC;\nDATA;\n{data}\nENDSEC;\nEND-ISO-10303-21;\n")
}

fn read(text: &str) -> File {
    File::read(text.as_bytes().to_vec()).expect("a Part 21 file")
}

fn codes(file: &File) -> Vec<&'static str> {
    file.problems().iter().map(|problem| problem.code).collect()
}

#[track_caller]
fn argument(file: &File, id: u64, n: usize) -> Value<'_> {
    let row = file.row(id).unwrap_or_else(|| panic!("#{id} is lost: {:?}", file.problems()));
    file.instance(row).expect("well formed").argument(n).clone()
}

fn text_of(file: &File, id: u64) -> String {
    argument(file, id, 0).text().expect("a string").to_owned()
}

#[test]
fn an_apostrophe_behind_a_page_directive_is_a_character() {
    let file = read(&with_data(
        "#1=A('\\S\\'7 is a section');\n#2=A('\\S\\''7');\n#3=A('C:\\S\\');\n#4=A('end \\S\\''');\n#5=A('\\\\S\\');",
    ));
    assert_eq!(codes(&file), [""; 0]);
    assert_eq!(text_of(&file, 1), "§7 is a section");
    assert_eq!(text_of(&file, 2), "§7");
    assert_eq!(text_of(&file, 3), "C:\\S\\");
    assert_eq!(text_of(&file, 4), "end §");
    assert_eq!(text_of(&file, 5), "\\S\\");
    assert_eq!(
        &file.bytes()[file.span(file.row(1).expect("read"))],
        b"#1=A('\\S\\'7 is a section');"
    );
}

#[test]
fn print_directives_separate_tokens_and_are_breaks_in_strings() {
    let file = read(&with_data("#1=A\\N\\(\\N\\'a\\N\\b'\\F\\,\\N\\ #1\\N\\);\\N\\#2=B(1);"));
    assert_eq!(codes(&file), [""; 0]);
    assert_eq!(text_of(&file, 1), "a\nb");
    assert_eq!(argument(&file, 1, 1), Value::Reference(1));
    assert_eq!(argument(&file, 2, 0), Value::Integer(1));
}

#[test]
fn comments_may_stand_anywhere_between_tokens() {
    let file = read(
        "/* before; 'x' */ISO-10303-21/**/;/* #9=A(); */HEADER/* h */;FILE_SCHEMA/**/(/**/('S'/* ' */)/**/);ENDSEC/* e */;\
         DATA/* d */;/* #8=B(); */#/* i */1/* = */=/* k */A/* ( */(/*,*/1/*,*/,/*)*/(2/**/,/* // */3)/* ' */)/* ; */;\
         #2=(/*a*/B/**/(1/* * ** / */)/**/C/**/(/**/)/**/);#3=A('/* no comment */');ENDSEC;END-ISO-10303-21/**/;/* behind */",
    );
    assert_eq!(codes(&file), [""; 0]);
    assert_eq!(file.len(), 3);
    assert_eq!(argument(&file, 1, 1).items().len(), 2);
    assert_eq!(file.keyword(file.row(2).expect("read")), "B C");
    assert_eq!(text_of(&file, 3), "/* no comment */");
    assert_eq!(file.schemas(), ["S"]);
}

#[test]
fn a_comment_that_is_never_closed_takes_its_line_only() {
    let file = read(&with_data("#1=A(1);\n#2=B(/* lost,\n2);\n#3=C(3); /* and another\n#4=D(4);"));
    assert_eq!(codes(&file), ["unterminated-comment"]);
    assert_eq!((file.problems()[0].line, file.problems()[0].column), (7, 6));
    assert_eq!(file.len(), 4);
    assert_eq!(argument(&file, 2, 0), Value::Integer(2));
    assert_eq!(file.span(file.row(2).expect("read")).len(), "#2=B(/* lost,\n2);".len());
}

#[test]
fn a_forgotten_apostrophe_in_a_file_of_one_line_costs_one_instance() {
    let file = read("ISO-10303-21;HEADER;FILE_SCHEMA(('S'));ENDSEC;DATA;#1=A('a);#2=B(2);#3=C(3);ENDSEC;END-ISO-10303-21;");
    assert_eq!(codes(&file), ["unterminated-string"]);
    assert_eq!(file.len(), 2);
    assert_eq!(argument(&file, 3, 0), Value::Integer(3));
}

#[test]
fn identifiers_reach_to_64_bits_and_no_further() {
    let file = read(&with_data(
        "#18446744073709551615=A(#4294967296);\n#4294967296=B(#18446744073709551615,#1);\n#1=C(# 4294967296);\n\
         #18446744073709551616=D();\n#0=E(#18446744073709551616);",
    ));
    assert_eq!(file.highest_id(), u64::MAX);
    assert_eq!(argument(&file, u64::MAX, 0), Value::Reference(4_294_967_296));
    let users = |id| file.inverse(id).iter().map(|&row| file.id(row)).collect::<Vec<_>>();
    assert_eq!(users(4_294_967_296), [1, u64::MAX]);
    assert_eq!(users(u64::MAX), [4_294_967_296]);
    assert!(codes(&file).contains(&"identifier"), "{:?}", file.problems());
    assert!(file.instance(file.row(0).expect("read")).is_err());
    let mut edits = Edits::new(&file);
    assert!(edits.append("F()").is_err(), "no identifier is left");
}

#[test]
fn a_blank_between_number_sign_and_number_is_read_over() {
    let file = read(&with_data("# 1 = A( # 2 );\n#\t2=B(#1 ,\n# 1);"));
    assert_eq!(codes(&file), [""; 0]);
    assert_eq!(file.inverse(2).len(), 1);
    assert_eq!(argument(&file, 2, 1), Value::Reference(1));
    assert_eq!(&file.bytes()[file.span(file.row(1).expect("read"))], b"# 1 = A( # 2 );");
}

#[test]
fn constants_of_a_schema_are_values_by_name() {
    let file = read(&with_data("#1=A(#ORIGIN,@pi,(@E1));"));
    assert_eq!(argument(&file, 1, 0), Value::EntityConstant("ORIGIN".into()));
    assert_eq!(argument(&file, 1, 1), Value::ValueConstant("PI".into()));
    assert_eq!(argument(&file, 1, 2).to_string(), "(@E1)");
}

#[test]
fn anchors_and_references_keep_their_tags_and_broken_ones_cost_only_themselves() {
    let file = read(
        "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('S'));\nENDSEC;\nANCHOR;\n<a b/c>=#1 {unit:'mm'}{ 1x : (1,<u#v>) };\n\
         <broken=#1;\n<name>=$;\n<value>=@4;\n<text>='it''s; here';\nENDSEC;\n\
         REFERENCE;\n#10=<plan.stpnc#a;b> {v:2};\n#11=wrong;\n@4=<#name>;\n#12=<x'y#z>;\nENDSEC;\n\
         DATA;\n#1=A(#10,#12,#11);\nENDSEC;\nEND-ISO-10303-21;\n",
    );
    let anchors: Vec<&str> = file.anchors().iter().map(|anchor| anchor.name.as_str()).collect();
    assert_eq!(anchors, ["a b/c", "name", "value", "text"]);
    assert_eq!(file.anchors()[0].tags[0], ("unit".to_owned(), Value::String("mm".into())));
    assert_eq!(file.anchors()[0].tags[1].1.to_string(), "(1,<u#v>)");
    assert_eq!(file.external(10), Some("plan.stpnc#a;b"));
    assert_eq!(file.external(12), Some("x'y#z"));
    assert_eq!(file.externals()[1].name, ExternalName::Value(4));
    assert_eq!(file.externals()[0].tags.len(), 1);
    assert_eq!(codes(&file), ["anchor", "reference-section", "missing-instance"]);
    assert!(
        file.problems()[2].message.starts_with("#1 refers to #11"),
        "{}",
        file.problems()[2]
    );
}

#[test]
fn several_data_sections_and_signatures_are_read_and_new_instances_go_to_the_last() {
    let text = "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('A','B'));\nENDSEC;\nDATA('one',('A'));\n#1=A(#2);\nENDSEC;\n\
                DATA ( 'two' , ('B') ) ;\n#2=B(#1);\nENDSEC;\nEND-ISO-10303-21;\nSIGNATURE;\nMII=\nENDSEC;\nSIGNATURE\n;\nQQ==\nENDSEC;\n";
    let file = read(text);
    assert_eq!(codes(&file), [""; 0]);
    assert_eq!(file.data_sections()[1].parameters[0].text(), Some("two"));
    assert_eq!(file.inverse(1), [file.row(2).expect("read")]);
    let unchanged = Edits::new(&file).save().expect("nothing to refuse");
    assert_eq!((unchanged.bytes.as_slice(), unchanged.notices.len()), (text.as_bytes(), 0));
    let mut edits = Edits::new(&file);
    edits.append("C()").expect("well formed");
    let saved = edits.save().expect("there is a place for it");
    let expected = text.replace("#2=B(#1);\n", "#2=B(#1);\n#3=C();\n");
    let signatures = expected.find("SIGNATURE").expect("it is signed");
    let bytes = String::from_utf8(saved.bytes).expect("text");
    assert_eq!(bytes.trim_end(), expected[..signatures].trim_end());
    assert_eq!(saved.notices.len(), 1);
}

#[test]
fn sections_in_lower_case_and_line_ends_of_all_kinds_are_read() {
    let file = read(
        "iso-10303-21;\r\nheader;\rfile_schema(('s'));\rendsec;\rdata;\r#1=a('x',.t.);\r#2 = (b(1)c());\rendsec;\rend-iso-10303-21;\r",
    );
    assert_eq!(codes(&file), [""; 0]);
    assert!(file.is(file.row(1).expect("read"), "A") && file.is(file.row(2).expect("read"), "C"));
    assert_eq!(argument(&file, 1, 1).boolean(), Some(true));
    assert!(
        file.instance(file.row(2).expect("read"))
            .expect("well formed")
            .part("B")
            .is_some()
    );
    assert_eq!(file.schemas(), ["S"]);
}

#[test]
fn numbers_as_writers_write_them() {
    let file = read(&with_data(
        "#1=A(1.,-.5,+2,1.E3,1e-3,1.5e+02,-0.,00012,99999999999999999999);",
    ));
    let numbers: Vec<f64> = (0..9).filter_map(|n| argument(&file, 1, n).number()).collect();
    assert_eq!(numbers, [1.0, -0.5, 2.0, 1000.0, 0.001, 150.0, -0.0, 12.0, 1e20]);
    assert_eq!(argument(&file, 1, 7), Value::Integer(12));
}

#[test]
fn lists_a_million_deep_are_indexed_and_refused_when_asked_for() {
    let deep = format!("#1=A({}1{});\n#2=B(2);", "(".repeat(1_000_000), ")".repeat(1_000_000));
    let file = read(&with_data(&deep));
    let problem = file.instance(file.row(1).expect("indexed")).expect_err("too deep");
    assert_eq!((problem.code, problem.line), ("nesting", 6));
    assert_eq!(argument(&file, 2, 0), Value::Integer(2));
    let open = read(&with_data(&format!("#1=A({};\n#2=B(2);", "(".repeat(1_000_000))));
    assert_eq!(codes(&open), ["parentheses"]);
    let typed = read(&with_data(&format!("#1={}{};", "A(".repeat(500_000), ")".repeat(500_000))));
    assert!(typed.instance(typed.row(1).expect("indexed")).is_err());
}

#[test]
fn reading_takes_time_in_proportion_to_the_length_whatever_the_bytes_are() {
    let many = 200_000;
    for data in [
        format!("#1=A('{}", "\n".repeat(10 * many)),
        format!("#1=A('{}", "\n  ".repeat(5 * many)),
        "/*\n#1=A(/*);\n".repeat(many),
        "#1=A(';".repeat(many),
        "#1=A('".repeat(many),
        "#1='x'';#2=".repeat(many),
        format!("x{}", "\n \t".repeat(5 * many)),
        "#".repeat(10 * many),
        "=".repeat(10 * many),
        "#1=".repeat(5 * many),
        ";".repeat(10 * many),
        "#1=A(#1,#1,#1,#1);\n".repeat(many),
        format!("#1=({});", "A()".repeat(many)),
        format!("#1=A({});", "#1,".repeat(5 * many)),
        "\\N\\".repeat(3 * many),
        "SIGNATURE;".repeat(many),
        "DATA;".repeat(many),
    ] {
        let text = with_data(&data);
        let file = read(&text);
        let rows: Vec<_> = file.rows().collect();
        for &row in rows.iter().take(2000) {
            let _ = file.instance(row).map(|instance| matches!(instance, Instance::Complex(_)));
            assert!(file.span(row).end <= text.len());
        }
        assert_eq!(Edits::new(&file).save().expect("unchanged").bytes, text.as_bytes());
    }
}
