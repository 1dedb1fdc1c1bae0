"""Thousands of logs of many axes: one table, one page."""

from __future__ import annotations

from pmsm_ctrl.fleet import present as present
from pmsm_ctrl.fleet.answers import FleetReport, fleet_report
from pmsm_ctrl.fleet.engine import Engine
from pmsm_ctrl.fleet.manifest import Manifest, Settings, manifest_of, read_manifest
from pmsm_ctrl.fleet.result import FleetResult
from pmsm_ctrl.fleet.run import fleet
from pmsm_ctrl.fleet.store import COLUMNS, Row, Store

__all__ = [
    "COLUMNS", "Engine", "FleetReport", "FleetResult", "Manifest", "Row", "Settings", "Store", "fleet", "fleet_report",
    "manifest_of", "read_manifest",
]  # fmt: skip
