"""The contents of a report before they are written: sections of text, tables and figures."""

from dataclasses import astuple, dataclass, field, fields, is_dataclass

from ..stopwatch import Share, Spread

INTERRUPTED = "This report was interrupted: it holds only some of what was asked for."


@dataclass(frozen=True)
class Table:
    """Rows of one kind.

    Attributes:
        name: Name of its CSV file without ".csv", unique in a report.
        caption: One sentence on the rows.
        rows: Instances of one frozen dataclass.  What is printed is Annotated[type, heading],
            the heading with its unit; other fields stand in CSV and JSON alone.  Values are
            numbers, text, bool, None or Spread (ms, or what the row's `unit` says; a Share is
            in percent).  None prints as a dash; a bool as yes and no, but one named `passed`
            as pass and FAIL; `default` marks a row in bold.
    """

    name: str
    caption: str
    rows: list

    @property
    def headings(self) -> dict[str, str]:
        """Attribute -> heading, for all printed columns in which any row has a value."""
        return {
            column.name: heading
            for column in (fields(self.rows[0]) if self.rows else ())
            for heading in getattr(column.type, "__metadata__", ())
            if any(getattr(row, column.name) is not None for row in self.rows)
        }


@dataclass(frozen=True)
class Figure:
    """A picture."""

    name: str  # name of its file without ".png", unique in a report
    caption: str
    png: bytes


@dataclass(frozen=True)
class Section:
    """What a report says on one subject."""

    key: str  # in the JSON and in links
    title: str
    findings: list[str]  # a sentence or two each; the first one stands in the summary
    method: list[str] = field(default_factory=list)  # how it was measured, a paragraph each
    tables: list[Table] = field(default_factory=list)  # shown below the figures
    figures: list[Figure] = field(default_factory=list)
    passed: bool | None = None  # None without a criterion
    values: dict = field(default_factory=dict)  # further values for the JSON
    seconds: float | None = None  # to measure it; None if not timed


@dataclass(frozen=True)
class Report:
    """The contents of a report."""

    title: str
    facts: dict[str, str]  # model, machine and date, in words
    sections: list[Section]
    complete: bool  # whether every requested section is there
    missing: tuple[str, ...] = ()

    @property
    def notice(self) -> str | None:
        """The notice above everything else."""
        missing = f" Missing: {', '.join(self.missing)}." if self.missing else ""
        return None if self.complete else INTERRUPTED + missing


def record(row) -> dict:
    """A row as plain values: what CSV and JSON hold.

    A Spread `frame` becomes frame_ms, frame_ms_low, frame_ms_high and frame_repeats; in a row
    with a `unit` of its own, frame, frame_low, frame_high and frame_repeats; a Share `relative`
    becomes relative_percent and so on.
    """
    assert is_dataclass(row), row
    plain = {}
    suffix = "" if hasattr(row, "unit") else "_ms"
    for column in fields(row):
        name, value = column.name, getattr(row, column.name)
        kind = getattr(column.type, "__origin__", column.type)  # of Annotated
        if kind in (Spread, Spread | None, Share):  # None leaves no column out
            median = f"{name}{suffix if kind is not Share else '_percent'}"
            names = median, f"{median}_low", f"{median}_high", f"{name}_repeats"
            plain |= dict(zip(names, (None,) * 4 if value is None else astuple(value), strict=True))
        else:
            plain[name] = value
    return plain
