"""`module load handover_gcs`: see the package gcs_module."""

from gcs_module.module import init  # noqa: F401
