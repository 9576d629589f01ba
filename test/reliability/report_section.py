"""Sections of docs/reliability.md that scripts write: each between two markers, the rest of the page is people's."""

import os


class SectionError(Exception):
    """What is wrong with the page, in words."""


def markers(name):
    return f"<!-- begin: {name} -->", f"<!-- end: {name} -->"


def replace(page, name, text):
    """The page with what stands between the section's markers replaced."""
    begin, end = markers(name)
    for marker in (begin, end):
        if page.count(marker) != 1:
            raise SectionError(f"expected the line '{marker}' once, found it {page.count(marker)} times")
    before, _, rest = page.partition(begin)
    old, found, after = rest.partition(end)
    if not found:
        raise SectionError(f"'{end}' comes before '{begin}'")
    return f"{before}{begin}\n{text.strip()}\n{end}{after}"


def write(path, name, text):
    """The same for a file: whole or not at all."""
    try:
        page = replace(path.read_text(), name, text)
    except SectionError as error:
        raise SectionError(f"{path}: {error}") from error
    partial = path.with_name(path.name + ".partial")
    partial.write_text(page)
    os.replace(partial, path)
