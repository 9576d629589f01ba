#!/usr/bin/env python3
"""Counts test cases over all packages after `colcon test`, shows what failed and why, and what was skipped and why.

usage: count_tests.py BUILD_FOLDER [--failed REASON]

Each CTest entry counts as its GoogleTest cases (build/PACKAGE/test_results/ENTRY.xml), or as one where there is no such file: another kind
of test, or a program that crashed. The last line is "N passed, N failed, N skipped"; the exit code is 0 if something passed and nothing failed.
"""

import argparse
import collections
import pathlib
import sys
import xml.etree.ElementTree as ElementTree

PASSED, FAILED, SKIPPED = "passed", "failed", "skipped"
# Lines of a failed program's output to show: its last words are there.
MAX_OUTPUT_LINES = 60

# One test case: its name, PASSED, FAILED or SKIPPED, and why it is not PASSED.
Case = collections.namedtuple("Case", "name outcome text")


def read_gtest_cases(path):
    """The cases of one GoogleTest XML file."""
    cases = []
    for element in ElementTree.parse(path).iter("testcase"):
        name = f"{element.get('classname')}.{element.get('name')}"
        failures = [failure.get("message", "") for failure in element.findall("failure")]
        skip = element.find("skipped")
        if failures:
            cases.append(Case(name, FAILED, "\n".join(failures)))
        elif skip is not None:
            # The message starts with the place in the source.
            cases.append(Case(name, SKIPPED, (skip.get("message") or "").strip().split("\n")[-1]))
        elif element.get("status") == "notrun":
            cases.append(Case(name, SKIPPED, "disabled"))
        else:
            cases.append(Case(name, PASSED, ""))
    return cases


def last_lines(text):
    return "\n".join((text or "").rstrip().split("\n")[-MAX_OUTPUT_LINES:])


def completion_status(entry):
    """CTest's own words on an entry: why it was not run, or how it ended."""
    for measurement in entry.iter("NamedMeasurement"):
        if measurement.get("name") in ("Completion Status", "Exit Value", "Exit Code"):
            text = measurement.findtext("Value") or ""
            if text and text != "Completed":
                return text
    return ""


def judge_entry(entry, results_folder):
    """The cases of one <Test> element of CTest's Test.xml."""
    name = entry.findtext("Name")
    status = entry.get("Status")
    how = completion_status(entry)
    if status == "notrun" and ("SKIP" in how or "Disabled" in how):
        return [Case(name, SKIPPED, how)]
    output = last_lines(entry.findtext("Results/Measurement/Value"))
    xml_file = results_folder / f"{name}.xml"
    if not xml_file.exists():
        return [Case(name, PASSED if status == "passed" else FAILED, f"{status} {how}\n{output}")]
    try:
        cases = read_gtest_cases(xml_file)
    except ElementTree.ParseError as error:
        return [Case(name, FAILED, f"{xml_file}: {error}\n{output}")]
    if status != "passed" and not any(case.outcome == FAILED for case in cases):
        # All cases passed, but not the program: a sanitizer's report, a crash at its end.
        cases.append(Case(name, FAILED, f"{status} {how}\n{output}"))
    if not cases:
        cases.append(Case(name, FAILED, "the program has no test case"))
    return cases


def judge_package(build_folder):
    """All cases of one package; none if it has no tests."""
    tag_file = build_folder / "Testing" / "TAG"
    if not tag_file.exists():
        return []
    test_xml = tag_file.parent / tag_file.read_text().split("\n")[0] / "Test.xml"
    try:
        tree = ElementTree.parse(test_xml)
    except (OSError, ElementTree.ParseError) as error:
        return [Case(str(test_xml), FAILED, str(error))]
    cases = []
    for entry in tree.iterfind("Testing/Test"):
        cases += judge_entry(entry, build_folder / "test_results")
    return cases


def report(packages):
    """Prints failures with their output, then the skipped cases by reason."""
    reasons = collections.defaultdict(list)
    for package, cases in packages.items():
        failed = [case for case in cases if case.outcome == FAILED]
        if failed:
            print(f"\n=== {package}: {len(failed)} failed")
        for case in failed:
            print(f"--- {case.name}\n{case.text}")
        for case in cases:
            if case.outcome == SKIPPED:
                reasons[case.text].append(case.name)
    if reasons:
        print("\nskipped:")
    for reason, names in sorted(reasons.items()):
        print(f"  {len(names)} x {reason or 'no reason given'} ({names[0]}{', ...' if len(names) > 1 else ''})")


def main(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--failed", metavar="REASON", help="counts as one more failure")
    options = parser.parse_args(arguments)
    packages = {folder.name: judge_package(folder) for folder in sorted(options.build.iterdir()) if folder.is_dir()}
    if options.failed:
        packages["colcon"] = [Case("colcon test", FAILED, options.failed)]
    report(packages)
    counts = collections.Counter(case.outcome for cases in packages.values() for case in cases)
    print()
    for package, cases in packages.items():
        if cases:
            of_package = collections.Counter(case.outcome for case in cases)
            print(f"{package}: {of_package[PASSED]} passed, {of_package[FAILED]} failed, {of_package[SKIPPED]} skipped")
    print(f"{counts[PASSED]} passed, {counts[FAILED]} failed, {counts[SKIPPED]} skipped")
    return 0 if counts[PASSED] > 0 and counts[FAILED] == 0 else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
