# SPDX-License-Identifier: GPL-3.0-or-later

"""Orders from a scenario to helper processes of a run, and their answers; to proxies by name or by pattern."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Sequence

from sitl.run.processes import Child, ProcessGone
from sitl.script.steps import StepFailed

__all__ = ["give_orders", "type_orders"]


def give_orders(child: Child, links: Sequence[str], orders: Sequence[str]) -> Callable[[], bool]:
    """Type `orders` at the proxy, each once for every one of its `links` that it means.

    The function tells whether all are carried out. Both raise StepFailed.
    """
    lines = []
    for order in orders:
        what, pattern, *rest = order.split()
        meant = fnmatch.filter(links, pattern)
        if not meant:
            raise StepFailed(f"{order!r}: no link through the proxy is called so: {', '.join(links)}")
        lines += [" ".join((what, link, *rest)) for link in meant]
    return type_orders(child, lines)


def type_orders(child: Child, lines: Sequence[str]) -> Callable[[], bool]:
    """Type lines at a helper process, which answers each by `ok` and the same.

    The function tells whether all are carried out. Both raise StepFailed.
    """
    answered = len(child.console())
    try:
        for line in lines:
            child.type(line)
    except ProcessGone as error:
        raise StepFailed(str(error)) from None

    def done() -> bool:
        answers = child.console()[answered:]
        wrong = [answer for answer in answers if not answer.startswith("ok ")]
        if wrong:
            raise StepFailed(wrong[0])
        return len(answers) == len(lines)

    return done
