# SPDX-License-Identifier: GPL-3.0-or-later

"""Makes the environments of the table: `python -m tests.clients.install FOLDER`. One that is whole is left alone."""

from __future__ import annotations

import shutil
import subprocess
import sys
import venv
from pathlib import Path

from tests.clients.table import ENVIRONMENTS, Environment

#: lies in an environment that is whole, and has what was asked for
_STAMP = "requirements.txt"


def _make(environment: Environment, folder: Path) -> None:
    """Raises CalledProcessError: pip could not install it; nothing is left then."""
    wanted = "\n".join(environment.requirements)
    stamp = folder / _STAMP
    if stamp.is_file() and stamp.read_text(encoding="utf-8") == wanted:
        return
    print(f"installing {', '.join(environment.requirements)} in {folder}", flush=True)
    shutil.rmtree(folder, ignore_errors=True)
    try:
        venv.create(folder, with_pip=True)
        pip = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", *environment.requirements]
        subprocess.run(pip, check=True)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    stamp.write_text(wanted, encoding="utf-8")


def main(folder: Path) -> int:
    """Returns the exit code; says which cannot be installed, and goes on with the others."""
    failed = []
    for environment in ENVIRONMENTS:
        try:
            _make(environment, folder / environment.name)
        except subprocess.CalledProcessError:
            failed.append(environment.name)
    if failed:
        print(f"could not be installed: {', '.join(failed)}", file=sys.stderr)
    return len(failed)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
