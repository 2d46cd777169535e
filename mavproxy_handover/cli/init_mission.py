# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover init mission`: a checked mission package, and configurations, from a plan and drawn zones.

Nothing is written until plan, zones and answers fit together. The mission is then written, loaded again and checked as
`handover check` does.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final

from mavproxy_handover.cli.check import judged
from mavproxy_handover.cli.check import main as check_main
from mavproxy_handover.cli.mission_job import AIRCRAFT, MISSION_FOLDER, Job, Missing, job_of
from mavproxy_handover.cli.new_folder import write_folder
from mavproxy_handover.cli.questions import Questions, at_terminal
from mavproxy_handover.config.files import load_station, load_vehicle
from mavproxy_handover.config.for_mission import is_placeholder
from mavproxy_handover.config.toml import ConfigError
from mavproxy_handover.mission.check_json import report_json
from mavproxy_handover.mission.drawn.files import ENDINGS
from mavproxy_handover.mission.energy import places_of
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.keys import POLICY
from mavproxy_handover.mission.package import load

__all__ = ["CODES", "EXAMPLES", "add_options", "run"]

CODES: Final = {
    0: "written, and the check passed",
    1: "written, and the check found errors",
    2: "wrong usage, or a file cannot be used: nothing was written",
}
EXAMPLES: Final = (
    (
        "handover init mission --plan survey.plan --zones stations.kml",
        "a folder survey/ with the mission and all configurations; at a terminal it asks what the files do not say",
    ),
    (
        "handover init mission --plan survey.plan --zones survey.plan --station GCSA --station GCSB",
        "the inclusion areas of the plan's geofence are the zones, in this order",
    ),
    (
        "handover init mission --plan survey.plan --zones stations.kml --json",
        "the same for programs: one object, and nothing is asked",
    ),
    (
        "handover init mission --plan p.waypoints --zones a.geojson b.geojson --aircraft plane --speed 18 --force",
        "a zone from each of two files; a folder that is there is kept under another name",
    ),
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `handover init mission`."""
    files = parser.add_argument_group("files")
    files.add_argument("--plan", type=Path, metavar="FILE", help="the route: a QGroundControl .plan, or .waypoints")
    files.add_argument(
        "--zones",
        type=Path,
        metavar="FILE",
        nargs="+",
        action="extend",
        help=f"the zones of the stations: {', '.join(ENDINGS)} (a plan: the inclusion areas of its geofence); several "
        "files may be given",
    )
    files.add_argument("--name", metavar="NAME", help="of the mission, up to 40 characters (default: the plan's name)")
    files.add_argument("--out", type=Path, metavar="DIR", help="folder to write (default: the plan's name)")
    files.add_argument(
        "--force", action="store_true", help="also if DIR is there: it is kept as DIR.old-1, its keys are copied"
    )
    told = parser.add_argument_group("what plan and zones may not say")
    told.add_argument("--aircraft", choices=AIRCRAFT, help="kind of aircraft (default: the plan's vehicleType)")
    told.add_argument("--speed", type=float, metavar="MPS", help="cruise speed (default: the plan's)")
    told.add_argument(
        "--station",
        metavar="NAME[=ZONE]",
        action="append",
        default=[],
        help="a station, and the name or number of its zone; once for each, the parent first (default: every zone is "
        "a station of that name)",
    )
    told.add_argument(
        "--parent", metavar="NAME", help="the station that starts the flight (default: the one whose zone holds home)"
    )
    told.add_argument(
        "--handovers", type=int, metavar="N", help="how many handovers you expect (default: as many as the route makes)"
    )
    told.add_argument(
        "--out-of-coverage",
        choices=POLICY["on_out_of_coverage"].words,
        help="what the aircraft does outside every zone (default: return)",
    )
    told.add_argument(
        "--terrain", type=Path, metavar="FILE", help="heights of the ground: an Esri ASCII grid in degrees"
    )
    told.add_argument(
        "--endless-jump", action="store_true", help="a DO_JUMP of the plan may repeat without end: the mission says so"
    )
    rest = parser.add_argument_group("vehicle and stations")
    rest.add_argument("--vehicle-name", metavar="NAME", help="what stations call the vehicle (default: drone-1)")
    rest.add_argument("--vehicle-sysid", type=int, metavar="ID", help="its MAVLink system id (default: 1)")
    rest.add_argument(
        "--address",
        metavar="NAME=HOST",
        action="append",
        default=[],
        help="where vehicle and other stations reach a station; once for each (default: a placeholder, 192.0.2.x)",
    )
    rest.add_argument("--battery-wh", type=float, metavar="WH", help="energy of the full battery (default: unknown)")
    rest.add_argument("--hover-w", type=float, metavar="W", help="power in hover (default: unknown)")
    parser.add_argument(
        "--json",
        action="store_true",
        help="for programs: what was written, and the check's result, as one object; nothing is asked",
    )


def run(arguments: argparse.Namespace, ask: Callable[[str], str] | None = None) -> int:
    """Write a mission, and return the exit code. `ask`: reads an answer; None: `input` at a terminal, else nothing."""
    questions = Questions(ask or (input if at_terminal() and not arguments.json else None))
    missing: Sequence[str] = ()
    try:
        job = job_of(arguments, questions)
        arguments.out = job.out
        kept = _write(job, arguments.force)
    except MissionError as error:
        faults: Sequence[str] = error.faults
    except ConfigError as error:
        faults = [str(error)]
    except OSError as error:
        where = arguments.out or error.filename
        faults = [f"{where}: {error.strerror or error}. Nothing was written: give another --out"]
    except (EOFError, KeyboardInterrupt):
        faults = ["no answer: nothing was written"]
    except Missing as error:
        missing = error.options
        faults = [f"{each}. Give this option" for each in missing]
    else:
        if arguments.json:
            return _as_json(job, kept)
        print("\n".join(_told(job, kept)))
        return _checked(job)
    if arguments.json:
        options = [dict(zip(("option", "meaning"), each.split(": ", 1), strict=False)) for each in missing]
        print(json.dumps({"written": False, "passed": False, "faults": list(faults), "missing": options}, indent=1))
    for line in faults:
        print(f"handover init: {line}", file=sys.stderr)
    return 2


# ---- writing, and what is told -------------------------------------------------------------------------------------


def _write(job: Job, force: bool) -> Path | None:
    def judge(folder: Path) -> None:
        try:
            load(folder / MISSION_FOLDER)
            load_vehicle(folder / "handover.toml")
            for site in job.sites:
                load_station(folder / f"{site.name}.toml")
        except (MissionError, ConfigError) as error:
            raise MissionError(str(error).replace(str(folder.resolve()), str(job.out))) from None

    return write_folder(job.out, job.files, ("keys",) if force else (), judge)


def _told(job: Job, kept: Path | None) -> Iterator[str]:
    """What was written, and where each part of it comes from."""
    yield f"{job.out} written:"
    names = ", ".join(name.partition("/")[2] for name in job.files if "/" in name)
    yield f"  {MISSION_FOLDER + '/':20} the mission package: {names}"
    yield f"  {'handover.toml':20} configuration of the vehicle's companion"
    for number, site in enumerate(job.sites):
        parent = ", the parent" if number == 0 else ""
        yield f"  {site.name + '.toml':20} configuration of station {site.name} (system id {site.sysid}{parent})"
    if kept is not None:
        yield f"  the folder that was there is kept as {kept.name}"
    for station in job.stations:
        yield f"zone        {station.name}: {station.zone.place}"
    yield from (f"note        {note}" for note in job.notes)
    yield f"speed       {job.speed}"
    yield f"returns     {', '.join(place.name for place in places_of(job.package.route))}"
    without = [f"{site.name} {site.host}" for site in job.sites if is_placeholder(site.host)]
    if without:
        yield f"addresses   {', '.join(without)} are placeholders: put real ones in their place before a flight"
    yield ""


def _as_json(job: Job, kept: Path | None) -> int:
    """Check what was written, and print all that is told as one object. Returns the exit code."""
    report = judged(load(job.out / MISSION_FOLDER), str(job.out / "handover.toml"))
    told = {
        "written": True,
        "passed": report.exit_code == 0,
        "folder": str(job.out),
        "kept": None if kept is None else str(job.out.with_name(kept.name)),
        "files": sorted(job.files),
        "stations": [
            {
                "name": site.name,
                "sysid": site.sysid,
                "parent": number == 0,
                "zone": station.zone.place,
                "address": site.host,
                "placeholder": is_placeholder(site.host),
            }
            for number, (site, station) in enumerate(zip(job.sites, job.stations, strict=True))
        ],
        "speed": {"mps": job.package.cruise_speed_mps, "text": job.speed},
        "return_sites": [place.name for place in places_of(job.package.route)],
        "notes": list(job.notes),
        "next": list(_commands(job)) if report.exit_code == 0 else [],
        "check": report_json(report),
    }
    print(json.dumps(told, indent=1))
    return report.exit_code


def _checked(job: Job) -> int:
    """Check what was written as `handover check` does, and say what comes next. Returns the exit code."""
    code = check_main([str(job.out / MISSION_FOLDER), "--config", str(job.out / "handover.toml")])
    print()
    print("\n".join(_next_steps(job, code == 0)))
    return code


def _commands(job: Job) -> Iterator[str]:
    """The commands that come next."""
    profile = job.package.profile
    vehicle = f" --vehicle {profile.name}" if profile.flies_past else ""  # the embedded vehicle has no wings
    yield f"cd {shlex.quote(str(job.out))}"
    yield f"handover keys make {' '.join(site.name for site in job.sites)}"
    yield f"handover sim --mission {MISSION_FOLDER}{vehicle}"


def _next_steps(job: Job, passed: bool) -> Iterator[str]:
    if not passed:
        yield "Put right what is an error in plan or zones, then type the same command again with --force."
        return
    yield "next:"
    yield from (f"  {command}" for command in _commands(job))
    yield "for a flight, copy:"
    yield f"  handover.toml, {', '.join(f'keys/{site.name}.key' for site in job.sites)}  to the companion computer"
    ground = ", keys/ground.key" if len(job.sites) > 1 else ""
    for number, site in enumerate(job.sites):
        package = f", {MISSION_FOLDER}/" if number == 0 else ""
        yield f"  {site.name}.toml, keys/{site.name}.key{ground}{package}  to {site.name}"
    yield "Each file names the command that starts its program."
