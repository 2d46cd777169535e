# SPDX-License-Identifier: GPL-3.0-or-later

"""Packages of this folder, and the version of the main package: pyproject.toml cannot name them."""

from __future__ import annotations

import re
from email.parser import HeaderParser
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

HERE = Path(__file__).resolve().parent
_VERSION_OF = HERE.parent / "mavproxy_handover" / "tools" / "version.py"


def version() -> str:
    """The version of the repository. A source distribution lacks the rest of it, and has its own."""
    if _VERSION_OF.is_file():
        return str(re.findall(r'^VERSION = "(.+)"$', _VERSION_OF.read_text(encoding="utf-8"), re.MULTILINE)[0])
    return str(HeaderParser().parsestr((HERE / "PKG-INFO").read_text(encoding="utf-8"))["Version"])


class Build(build_py):  # type: ignore[misc]
    """build_py without this module, which lies in the folder of the package."""

    def find_package_modules(self, package: str, package_dir: str) -> list[tuple[str, str, str]]:
        """Package, name and file of each module."""
        return [module for module in super().find_package_modules(package, package_dir) if module[1] != "setup"]


VERSION = version()
setup(
    cmdclass={"build_py": Build},
    version=VERSION,
    install_requires=[f"mavproxy-handover=={VERSION}", "lupa>=2.2", "matplotlib>=3.7", "plotly>=5.20"],
    package_dir={"sitl": "."},
    packages=["sitl", *(f"sitl.{name}" for name in find_packages(str(HERE), exclude=["build*"]))],
)
