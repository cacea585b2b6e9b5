"""The files of a report are written over those of an older one."""

import json
import re

from deformrf.wings.lab.report.contents import Figure, Report, Section
from deformrf.wings.lab.report.writing import write

from .kinds import Fault, Kind
from .process import Job

FIGURES = 12


def write_report(number, folder):
    """Each file says the number."""
    image = b"\x89PNG" + bytes([number]) * 200_000
    figures = [Figure(f"f{k}", f"n {number}", image) for k in range(FIGURES)]
    section = Section("a", "A", [f"n {number}"], figures=figures)
    write(Report("Killed", {"n": f"n {number}"}, [section], True), folder)


class WrittenReport(Kind):
    def put(self, number):
        self.has_old = self.rng.random() < 0.5
        if self.has_old:
            write_report(1, self.out)

    def job(self):
        return Job((2, self.out), write_report)

    def look(self, ended):
        names = {f"f{k}.png" for k in range(FIGURES)} | {"report.html", "report.md", "report.json"}
        self.check_strays(ended, *names)
        numbers = {}
        for path in self.out.iterdir():
            content = path.read_bytes()
            if path.suffix == ".png":
                if len(content) != 200_004 or len({*content[4:]}) != 1:
                    raise Fault(f"{path.name} is not whole")
                numbers[path.name] = {content[-1]}
            else:
                numbers[path.name] = {int(n) for n in re.findall(r"\bn (\d+)", content.decode())}
        found = set().union(*numbers.values())
        if len(found) > 1 or (numbers and "report.html" not in numbers):
            raise Fault(f"files of the reports {found}: {numbers}")
        if not numbers:
            return "absent"
        if len(numbers) == len(names):
            json.loads((self.out / "report.json").read_text(encoding="utf-8"))
        elif not ended.code:
            raise Fault(f"it is done with {len(numbers)} of {len(names)} files")
        some = "" if len(numbers) == len(names) else ", some of its files"
        return ("old" if found == {1} else "new") + some
