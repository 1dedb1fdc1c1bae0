"""Coverage-guided fuzzing of one reader with atheris: ``python -m tests.fuzz text --seconds 60``.

Needs atheris (`pip install atheris`). A crash is reported with its traceback and the bytes are kept in the folder of
``--corpus`` or the current one as ``crash-...``; ``--again FILE`` runs one such file.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path


def main() -> None:
    """Fuzz until the time is over; the exit status is that of libFuzzer, 0 when nothing was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("reader", help="text, hdf5, tdms, parquet, mat, mat_packed, mdf, npy, npz or design")
    parser.add_argument("--seconds", type=int, default=60, help="how long (60)")
    parser.add_argument("--corpus", type=Path, help="folder that keeps what reached new code")
    parser.add_argument("--again", type=Path, help="run this file once instead")
    parser.add_argument("--seed", type=int, default=1, help="of libFuzzer's random numbers")
    chosen = parser.parse_args()
    try:
        import atheris
    except ImportError:
        sys.exit("atheris is not installed: pip install atheris")
    # what is imported here is instrumented: its branches guide the fuzzer
    with atheris.instrument_imports(include=["pmsm_ctrl.importers", "pmsm_ctrl.design", "nptdms", "tomllib"]):
        from tests.fuzz.readers import READERS, seeds
    if chosen.reader not in READERS:
        sys.exit(f"no reader '{chosen.reader}' (known: {', '.join(READERS)})")
    reader = READERS[chosen.reader]
    if chosen.again is not None:
        reader(chosen.again.read_bytes())
        return
    with tempfile.TemporaryDirectory() as scratch:
        good = Path(scratch) / "seeds"
        good.mkdir()
        for k, content in enumerate(seeds(chosen.reader)):
            (good / f"{k}").write_bytes(content)
        kept = chosen.corpus or Path(scratch) / "corpus"
        kept.mkdir(parents=True, exist_ok=True)
        options = [
            f"-max_total_time={chosen.seconds}",
            "-max_len=8192",
            "-len_control=0",
            "-rss_limit_mb=3000",
            "-timeout=60",
        ]
        options += [f"-seed={chosen.seed}", "-print_final_stats=1", f"-artifact_prefix={chosen.corpus or '.'}/"]
        atheris.Setup([sys.argv[0], *options, str(kept), str(good)], reader)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
