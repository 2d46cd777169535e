# SPDX-License-Identifier: GPL-3.0-or-later

"""The short table at the end of a run on hosts of their own, made of `results.py`'s values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

__all__ = ["table"]


def table(results: Mapping[str, Any]) -> list[str]:
    """The lines."""
    return [*_hosts(results), *_paths(results), *_handovers(results), *_cut(results), *_tunnel(results)]


def _hosts(results: Mapping[str, Any]) -> Iterator[str]:
    yield "Hosts"
    for host in results["hosts"]:
        addresses = ", ".join(f"{name} {address}" for name, address in host["addresses"].items() if address)
        yield f"  {host['name']:<10} {host['says']:<20} {addresses}"
        for route in host["routes"]:
            yield f"  {'':<10} {'':<20} route {route}"


def _paths(results: Mapping[str, Any]) -> Iterator[str]:
    yield "Paths"
    for path, says in results["paths"].items():
        yield f"  {path:<10} {says}"
    yield "Links of the companion"
    for station, links in results["links"].items():
        for path, link in links.items():
            yield f"  {station:<10} {path:<8} {link}"


def _handovers(results: Mapping[str, Any]) -> Iterator[str]:
    yield "Handovers"
    for each in results["handovers"]:
        took = each["duration_s"]
        how_long = "" if took is None else f" in {took * 1000:.0f} ms"
        during = ", while the path was cut" if each["while_cut"] else ""
        yield f"  {each['at_s']:7.1f} s  to {each['to']}{how_long}{during}"
    if not results["handovers"]:
        yield "  none"


def _cut(results: Mapping[str, Any]) -> Iterator[str]:
    cut = results["cut"]
    yield "Cut"
    if cut is None:
        yield "  no path was cut"
        return
    healed = "not joined again" if cut["healed_s"] is None else f"joined again at {cut['healed_s']:.1f} s"
    yield f"  at {cut['at_s']:.1f} s, {healed}"
    for station, seen in cut["stations"].items():
        left = "did not change the link" if seen["switched_s"] is None else f"left it after {seen['switched_s']:.2f} s"
        silent = "not known" if seen["silent_s"] is None else f"{seen['silent_s']:.2f} s"
        yield f"  {station:<10} the companion {left}; longest time without telemetry at {station}: {silent}"
        for text in seen["companion"]:
            yield f"  {'':<10} companion: {text}"


def _tunnel(results: Mapping[str, Any]) -> Iterator[str]:
    tunnel = results["tunnel"]
    yield "Tunnel"
    if tunnel is None:
        yield "  none (--tunnel STATION makes one)"
        return
    yield f"  {', '.join(tunnel['stations'])}, by {tunnel['made_by']}, one interface for each path"
    for end, says in tunnel["ends"].items():
        yield f"  {end:<16} {says}"
    for path, cost in tunnel["paths"].items():
        yield (
            f"  {path:<10} {cost['added_bytes']:+.0f} bytes for each packet ({cost['packet_bytes']:.0f} become "
            f"{cost['packet_bytes_in_tunnel']:.0f}, mean of {cost['packets']}), and {cost['own_packets']} packets of "
            f"its own ({cost['own_bytes']} bytes)"
        )
        yield (
            f"  {'':<10} {cost['added_ms']:+.2f} ms there and back ({cost['plain_ms']:.2f} without, "
            f"{cost['tunnel_ms']:.2f} with it, medians of {cost['round_trips'][0]} and {cost['round_trips'][1]}; 99 % "
            f"within {cost['plain_99_ms']:.1f} and {cost['tunnel_99_ms']:.1f})"
        )
    if not tunnel["paths"]:
        yield "  its cost was not measured: the meter saw nothing"
