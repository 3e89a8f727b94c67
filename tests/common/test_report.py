"""Reports on a pipe to the process that has started this one."""

import logging
import os

import msgspec
from mecazen.runtime.report import Report, Reporter


def test_a_report_is_a_line_of_json_and_the_log_gets_warnings_only():
    out, into = os.pipe()
    reporter = Reporter(into)
    reports = [Report("serving", "http://127.0.0.1:1"), Report("ended", number=-9)]
    for report in reports:
        reporter.tell(report)
    os.close(into)
    with os.fdopen(out, "rb") as pipe:
        assert [msgspec.json.decode(line, type=Report) for line in pipe] == reports
    assert reporter.log_level == logging.WARNING


def test_where_nobody_reads_the_log_tells_all_and_reports_go_nowhere():
    assert Reporter(None).log_level == logging.INFO
    Reporter(None).tell(Report("started"))
    out, into = os.pipe()
    os.close(out)
    reporter = Reporter(into)
    reporter.tell(Report("started"))
    os.close(into)
    assert reporter.descriptor is None
