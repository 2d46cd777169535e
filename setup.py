# SPDX-License-Identifier: GPL-3.0-or-later

"""What pyproject.toml cannot say: files that the wheel puts outside its own packages.

* the Python of the dialect, made by pymavlink's mavgen from `wire/*.xml`, becomes data of the package;
* top-level modules: `handover` and `handover_gcs`, which MAVProxy loads by these names, and `handover_dialect`, which
  makes the dialect importable where pymavlink looks for dialects (a `.pth` file has Python import it at its start), so
  that `--dialect=handover` works in every program of the environment. No file goes into a folder of another package;
* manual pages and completion are made from the parsers of all commands (`reference/`), and go where `man` and shells
  look, below the prefix of the installation;
* missions and the guard, which live in folders of their own, and the constraints become data of the package;
* the README as an index page shows it: there its links and pictures lead nowhere if they are relative.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from itertools import chain
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.errors import SetupError

HERE = Path(__file__).resolve().parent
WIRE = HERE / "mavproxy_handover" / "wire"
TOP_LEVEL = tuple(HERE / package / "deploy" / "top_level" for package in ("mavproxy_handover", "gcs_module"))
DATA_FOLDERS = ("missions", "ardupilot_lua")
PICTURES = (".png", ".svg")
#: folder below the prefix where a shell looks -> name of its completion
COMPLETION = {
    "share/bash-completion/completions": "handover",
    "share/zsh/site-functions": "_handover",
    "share/fish/vendor_completions.d": "handover.fish",
}


def index_page() -> str:
    """The README with absolute links. They lead to the Homepage of [project.urls]."""
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    home = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]["Homepage"]

    def absolute(link: re.Match[str]) -> str:
        target = link[1]
        if "://" in target or target.startswith(("#", "mailto:")):
            return link[0]
        return f"]({home}/{'raw' if target.endswith(PICTURES) else 'blob'}/main/{target})"

    return re.sub(r"\]\(([^)\s]+)\)", absolute, (HERE / "README.md").read_text(encoding="utf-8"))


def make_dialect(target: Path) -> None:
    """Write the dialect's Python to `target`. The XML files that ours includes come from the installed pymavlink."""
    import pymavlink
    from pymavlink.generator import mavgen

    shipped = Path(pymavlink.__file__).parent / "dialects" / "v20"
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for xml in [*shipped.glob("*.xml"), *WIRE.glob("*.xml")]:
            shutil.copy(xml, work / xml.name)
        if any('name="CONTROL_STATUS"' in xml.read_text(encoding="utf-8") for xml in shipped.glob("*.xml")):
            text = (work / "handover.xml").read_text(encoding="utf-8")
            text = text.replace("operator_control.xml", "development.xml")
            (work / "handover.xml").write_text(text, encoding="utf-8")
        options = mavgen.Opts(output=str(work / "handover.py"), wire_protocol="2.0", language="Python3", validate=False)
        if not mavgen.mavgen(options, [str(work / "handover.xml")]):
            raise SetupError("pymavlink's mavgen could not make the dialect from wire/handover.xml")
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(work / "handover.py", target)


def make_manual(dialect: Path, manual: Path, completion: Path) -> None:
    """Write manual pages and completion to these folders, in a process that imports the commands from here."""
    for folder in (manual, completion):
        shutil.rmtree(folder, ignore_errors=True)
    command = [sys.executable, "-B", "-m", "reference.build", *map(os.path.abspath, (dialect, manual, completion))]
    if subprocess.run(command, cwd=HERE, check=False).returncode:
        raise SetupError("manual pages and completion could not be made: see above")


class Build(build_py):
    """build_py plus the dialect, the top-level modules and the data named at the head of this module."""

    def run(self) -> None:
        if self.editable_mode:
            raise SetupError(
                "an editable install cannot place the dialect and the top-level modules: use 'pip install .'"
            )
        super().run()
        build = Path(self.build_lib)
        data = build / "mavproxy_handover" / "data"
        dialect, manual, completion = data / "dialect" / "handover.py", build.parent / "man1", data / "completion"
        make_dialect(dialect)
        make_manual(dialect, manual, completion)
        self.distribution.data_files = [
            ("share/man/man1", sorted(os.path.relpath(page) for page in manual.glob("*.1"))),
            *((folder, [os.path.relpath(completion / name)]) for folder, name in COMPLETION.items()),
        ]
        for file in chain.from_iterable(folder.glob("handover*.p*") for folder in TOP_LEVEL):
            shutil.copy(file, build / file.name)
        for name in DATA_FOLDERS:
            target = data / name
            shutil.rmtree(target, ignore_errors=True)
            shutil.copytree(HERE / name, target)
        shutil.copy(HERE / "constraints.txt", data)


setup(
    cmdclass={"build_py": Build},
    long_description=index_page(),
    long_description_content_type="text/markdown",
)
