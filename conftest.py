"""Skipped tests are listed at the end; where everything is installed, `--no-skips` makes each a failure."""

from pathlib import Path

import pytest

TESTS = Path(__file__).parent / "tests"
LONGEST = [
    TESTS / name
    for name in (
        "studio/test_browser.py",
        "watch/test_watch.py",
        "docs/test_examples.py",
        "e2e/test_procam_board.py",
        "e2e/test_photographs.py",
        "experiments/test_experiments.py",
    )
]
"""Files that take longest begin first: one core would else end with the last of them, alone."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--no-skips", action="store_true", help="fail when a test is skipped")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: LONGEST.index(item.path) if item.path in LONGEST else len(LONGEST))


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if session.config.getoption("no_skips") and reporter and reporter.stats.get("skipped"):
        session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if terminalreporter.config.getoption("no_skips") and terminalreporter.stats.get("skipped"):
        terminalreporter.write_line("--no-skips: the skipped tests below fail this run", red=True)
