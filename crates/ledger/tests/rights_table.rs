//! Every action at every level as a golden file: the diff in review is the documentation of a change.

use expect_test::expect_file;

#[test]
fn every_action_meets_every_level_and_nobody() {
    expect_file!["golden/rights.txt"].assert_eq(&ledger::rights::table());
}
