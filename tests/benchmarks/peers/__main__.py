r"""Print what other sparse fits name on the logs of the third simulator and on EMPS.

pip install -e '.[peers]'
python -m tests.benchmarks.peers --clean 100 --hidden 100 --first 400 --emps --json peers.json
python -m tests.benchmarks.peers --only pmsm_ctrl.diagnose --merge peers.json --json peers.json --emps
python -m tests.benchmarks.peers --clean 0 --hidden 0 --merge peers.json      the tables again, nothing is run
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from tests.benchmarks.peers.cases import MUJOCO, OURS, emps_rows, rows_of
from tests.benchmarks.peers.methods import PEERS, VARIANTS
from tests.benchmarks.peers.table import merged, report

SCHEMA = "pmsm-ctrl/peers/1"
PACKAGES = ("pmsm-ctrl", "pysindy", "sysidentpy", "mujoco", "scikit-learn", "numpy", "scipy")


def main() -> None:
    """Run the methods over the logs, one row each, and print the tables."""
    args = _arguments()
    known = [*PEERS, *VARIANTS, MUJOCO, OURS]
    methods = [m for m in known if any(m.startswith(o) for o in args.only)] if args.only else [*PEERS, MUJOCO, OURS]
    if not methods:
        raise SystemExit(f"--only {' '.join(args.only)}: none of {', '.join(known)}")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    earlier = [json.loads(path.read_text("utf-8")) for path in args.merge]
    rows = merged(*(run["rows"] for run in earlier))
    for some in _worlds(args, [m for m in methods if m != MUJOCO]):
        rows = merged(rows, some)
        _write(args.json, rows, earlier)
    if args.emps:
        rows = merged(rows, emps_rows(methods))
    _write(args.json, rows, earlier)
    print(", ".join(f"{name} {number}" for name, number in _versions(earlier).items()))
    report(rows)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clean", type=int, default=100, help="logs in which nothing is hidden")
    parser.add_argument("--hidden", type=int, default=100, help="logs with one effect hidden")
    parser.add_argument("--first", type=int, default=400, help="first seed; the hidden ones follow the clean ones")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[], help="methods whose names begin so, variants included")
    parser.add_argument("--merge", nargs="*", type=Path, default=[], help="files of earlier runs, with --json")
    parser.add_argument("--json", type=Path, default=None, help="write the rows, after every log")
    parser.add_argument("--emps", action="store_true", help="the measured axis too, found by PMSM_CTRL_DATA")
    return parser.parse_args()


def _worlds(args: argparse.Namespace, methods: list[str]) -> Iterator[list[dict[str, Any]]]:
    """Rows of one world after another, until as many hidden ones could be made as were asked for."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from rich.progress import Progress

    clean = [(args.first + k, False) for k in range(args.clean)]
    hidden = [(args.first + args.clean + k, True) for k in range(2 * args.hidden)]
    if not clean and not hidden:
        return
    with Progress() as bar, ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        task = bar.add_task("worlds", total=args.clean + args.hidden)
        for cases, wanted in ((clean, args.clean), (hidden, args.hidden)):
            made, at = 0, 0
            while made < wanted and at < len(cases):
                some = cases[at : at + max(1, min(4 * args.jobs, wanted - made))]
                at += len(some)
                for rows in pool.map(rows_of, *zip(*some, strict=True), [methods] * len(some)):
                    made += bool(rows)
                    bar.update(task, advance=bool(rows))
                    yield rows


def _versions(earlier: list[dict[str, Any]]) -> dict[str, str]:
    out: dict[str, str] = {}
    for name in PACKAGES:
        try:
            out[name] = version(name)
        except PackageNotFoundError:
            continue
    return {k: v for run in earlier for k, v in run["versions"].items()} | out


def _write(path: Path | None, rows: list[dict[str, Any]], earlier: list[dict[str, Any]]) -> None:
    if path is not None:
        data = {"schema": SCHEMA, "versions": _versions(earlier), "rows": rows}
        path.write_text(json.dumps(data, indent=1, default=str), encoding="utf-8")


if __name__ == "__main__":
    main()
