"""`module load handover`: see the package mavproxy_handover."""

from mavproxy_handover.module import init  # noqa: F401
