"""Tables in sections of pages that scripts write (test/reliability/report_section.py): a row of the same name is replaced, those not made again stay."""

import datetime
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "reliability"))
import report_section  # noqa: E402  (its folder is known only now)


def line(cells):
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def head(columns):
    return line(columns) + "\n" + "|" + " --- |" * len(columns)


def split(text):
    return [cell.strip() for cell in text.strip().strip("|").split("|")]


def read(text):
    """Rows of the first table in the text, {column: cell} each."""
    lines = text.splitlines()
    begin = next((i for i, one in enumerate(lines) if one.startswith("| ")), len(lines))
    table = []
    for one in lines[begin:]:
        if not one.startswith("|"):
            break
        table.append(split(one))
    return [dict(zip(table[0], cells)) for cells in table[2:]]


def merge(text, columns, rows, order=()):
    """The rows (cells) of the table in the text with these in their place by the first cell, in this order of first cells, then as they come; all with
    these columns: what an old row lacks is "-"."""
    cells = {old[columns[0]]: [old.get(column) or "-" for column in columns] for old in read(text) if columns[0] in old}
    cells.update({row[0]: list(row) for row in rows})
    ranks = {name: rank for rank, name in enumerate(order)}
    return sorted(cells.values(), key=lambda row: ranks.get(row[0], len(ranks)))


def section_of(page, name):
    """What stands between the markers; "" without them."""
    begin, end = report_section.markers(name)
    return page.partition(begin)[2].partition(end)[0]


def cpu_model():
    """As the kernel names it, and how many of its cores there are for us."""
    names = [one.partition(":")[2].strip() for one in pathlib.Path("/proc/cpuinfo").read_text().splitlines() if one.startswith("model name")]
    return f"{names[0] if names else os.uname().machine}, {len(os.sched_getaffinity(0))} cores"


class Report:
    """Prints a table row by row and, if there is a page, writes its section again with each. Old rows stay as long as the introduction, which says how
    and on what it was measured, is the same. Raises SectionError at once where the page can't take the section.

      report = Report(path or None, "sequences (benchmark.py)", "Measured on ...", ("run", "ATE (m)"), 3, order=("kitchen", "halls"))
      report.add(["halls", "0.1"])  # of 3 runs
    """

    def __init__(self, path, section, introduction, columns, runs, order=()):
        self.path, self.section, self.introduction, self.order = path, section, introduction, order
        self.columns, self.rows, self.old = (*columns, "measured"), [], ""
        self.measured = f"{datetime.date.today().isoformat()}, {runs} run{'s' if runs > 1 else ''}"
        if path is not None:
            self._check()
        print(head(columns), flush=True)

    def _page(self):
        page = self.path.read_text() if self.path.exists() else "# Figures\n"
        if any(marker in page for marker in report_section.markers(self.section)):
            return page
        begin, end = report_section.markers(self.section)
        return f"{page.rstrip()}\n\n{begin}\n{end}\n"

    def _check(self):
        if not self.path.parent.is_dir():
            raise report_section.SectionError(f"{self.path}: no such folder")
        page = self._page()
        try:
            report_section.replace(page, self.section, "")
        except report_section.SectionError as error:
            raise report_section.SectionError(f"{self.path}: {error}") from error
        old = section_of(page, self.section)
        self.old = old if self.introduction in old else ""
        if old.strip() and not self.old:
            names = ", ".join(row.get(self.columns[0], "?") for row in read(old))
            print(f"{self.path}: rows measured in another way or on another machine go: {names}", file=sys.stderr)

    def add(self, cells):
        print(line(cells), flush=True)
        if self.path is None:
            return
        self.rows.append([*cells, self.measured])
        table = [head(self.columns), *map(line, merge(self.old, self.columns, self.rows, self.order))]
        if not self.path.exists() or self._page() != self.path.read_text():
            self.path.write_text(self._page())
        report_section.write(self.path, self.section, self.introduction + "\n\n" + "\n".join(table))
