"""The committed reports: `python reports/make_gallery.py [NAME ...]` writes them again, into reports/gallery/.

Three are what the commands write. The page on EMPS is made here from results alone, because the measured data must not
be redistributed: it holds tables, models, and means over bins of a hundred samples and more.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pmsm_ctrl import Design, compensate, diagnose, identify, read_log, simulate, study
from pmsm_ctrl.diagnose import Diagnosis
from pmsm_ctrl.diagnose.figures import falling_figure
from pmsm_ctrl.export.tables import friction_table
from pmsm_ctrl.files import write_text
from pmsm_ctrl.log import Log, Provenance
from pmsm_ctrl.rendering.numbers import probability
from pmsm_ctrl.report import Headline, headline_of, render
from pmsm_ctrl.report.catalogue import save_figure
from pmsm_ctrl.section import Picture, Section, Table

ROOT = Path(__file__).resolve().parent.parent
GALLERY = Path("reports/gallery")
PICTURE = Path("docs/error_falling.svg")
BLUE, VERMILION, SOFT = "#0072B2", "#D55E00", "#4a5768"  # Okabe and Ito, safe for the colour-blind


def command(name: str) -> str:
    """Return the command that writes a page again."""
    return f"python reports/make_gallery.py {name}"


def reference_experiment() -> None:
    """The reference paper's speed sweep, in simulation."""
    design = Design.read("designs/seed_motor.toml")
    study(design, output=GALLERY / "reference_experiment.html", command=command("reference_experiment"))


# Effects of the simulated axis that the design does not have.
HIDDEN = (
    ("cogging", {"a_s": 0.006, "a_c": 0.003, "order": 24.0}),
    ("viscous_asymmetry", {"dF_v": 4e-5}),
    ("stribeck", {"dF_s": 0.012, "w_s": 4.0, "delta": 2.0}),
)


def hidden_logs(design: Design) -> tuple[Log, Log]:
    """Return two records of the axis with the hidden effects, with different noise and test signals."""
    from pmsm_ctrl.simulate import scenario

    truth = design
    for effect, parameters in HIDDEN:
        truth = truth.with_effect(effect, parameters)
    logs = []
    for seed, name in ((1, "monday"), (2, "tuesday")):
        log = simulate(design, scenario("identification", design, seed=seed), truth=truth, seed=seed)
        note = f"simulated with {', '.join(effect for effect, _ in HIDDEN)} hidden from the design; seed {seed}"
        logs.append(Log(dict(log.channels), provenance=Provenance(file=f"{name} (simulated)", notes=(note,))))
    return logs[0], logs[1]


def hidden_effects() -> None:
    """Three effects hidden from the design and found again; and the picture of the README."""
    design = Design.read("designs/seed_motor.toml")
    log, other = hidden_logs(design)
    done = study(
        design, log, holdout=other, output=GALLERY / "hidden_effects.html", command=command("hidden_effects")
    )  # fmt: skip
    found = done.results["diagnose"]
    assert isinstance(found, Diagnosis)
    save_figure(falling_figure(found), PICTURE)


def compensation() -> None:
    """Friction compensation at low speed, and the gain up to which it is safe."""
    design = Design.read("designs/low_speed.toml")
    found = compensate(design)
    variants = list(dict.fromkeys(row.variant for row in found.table if row.variant != "none"))
    section = found.section()
    text = render(
        section.title, [section.without(found.notices), _gains(found, variants)],
        headline=headline_of(found), notices=found.notices,
        design_toml=design.to_toml(), command=command("compensation"), facts={"design": design.source, "seed": "0"},
    )  # fmt: skip
    write_text(GALLERY / "compensation.html", text)


def _gains(found: Any, variants: list[str]) -> Section:
    """Reduction of the error by each compensation: a table and its picture."""
    metrics = (("rms", "rms error"), ("reversal_peak", "peak in the reversal"))
    rows = []
    for variant in variants:
        for factor in sorted({row.factor for row in found.table if row.variant == variant}):
            cells = (f"{100 * found.change(variant, metric, factor):+.0f} %" for metric, _ in metrics)
            rows.append((variant, "right" if factor == 1.0 else f"{100 * (factor - 1):+.0f} %", *cells))
    return Section(
        "Reduction of the error",
        (
            "Reversals at 0.5, 2 and 10 rad/s, the worst of the three, relative to no friction compensation.",
            Table(("compensated", "parameters", *(name for _, name in metrics)), tuple(rows)),
            Picture(
                lambda: _bars(found, variants, metrics),
                "Remaining error. Effects that are not compensated (Stribeck, cogging) remain; wrong parameters cost "
                "a part of the reduction.",
            ),
        ),
    )


def _bars(found: Any, variants: list[str], metrics: tuple[tuple[str, str], ...]) -> Figure:
    factors = sorted({row.factor for row in found.table})
    figure = Figure(figsize=(7.6, 1.2 + 0.42 * len(variants)), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (metric, name) in zip(panels, metrics, strict=True):
        for offset, factor, color in zip((-0.27, 0.0, 0.27), factors, (VERMILION, BLUE, "#009E73"), strict=False):
            tried = {row.variant for row in found.table if row.factor == factor}
            left = [100 * (1 + found.change(v, metric, factor)) if v in tried else np.nan for v in variants]
            label = "right" if factor == 1.0 else f"{100 * (factor - 1):+.0f} %"
            axes.barh(np.arange(len(variants)) + offset, left, 0.25, color=color, label=label)
        axes.set(xlabel=f"{name} left [% of none]", xlim=(0, 100))
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_yticks(range(len(variants)), variants)
    panels[0].invert_yaxis()
    panels[1].legend(title="parameters", frameon=False, fontsize="small")
    return figure


def binned(found: Diagnosis) -> tuple[Figure, int]:
    """Draw the mean residual over speed in bins, before and after; return the figure and the smallest bin."""
    figure = Figure(figsize=(7.6, 3.4), layout="constrained")
    axes = figure.subplots()
    smallest = 1 << 30
    for fit, color, label in (
        (found.selection.fits[0], VERMILION, "as identified"),
        (found.selection.fits[-1], BLUE, "with the missing effects"),
    ):
        speed = fit.record.at_grid(fit.record.signals["omega"])[fit.record.mask]
        residual = fit.residual[0][fit.record.mask]
        edges = np.quantile(speed, np.linspace(0, 1, 15))
        place = np.clip(np.searchsorted(edges, speed) - 1, 0, 13)
        counts = np.bincount(place, minlength=14)
        smallest = min(smallest, int(counts.min()))
        centre, mean = (np.bincount(place, weights=w, minlength=14) / counts for w in (speed, residual))
        axes.plot(centre, mean, "o-", color=color, label=label)
    axes.axhline(0.0, color=SOFT, linewidth=0.8)
    axes.set(xlabel="speed [m/s]", ylabel="mean force residual [N]")
    axes.legend(frameon=False)
    axes.grid(alpha=0.3)
    return figure, smallest


def friction_curves(before: Design, after: Design) -> Figure:
    """Draw the friction of the two models over speed."""
    figure = Figure(figsize=(7.6, 3.4), layout="constrained")
    axes = figure.subplots()
    half = np.geomspace(1e-4, 0.2, 60)
    for design, color, label in ((before, VERMILION, "as identified"), (after, BLUE, "with the missing effects")):
        for speeds, name in ((half, label), (-half, None)):
            table = friction_table(design, speeds)
            axes.plot(table[:, 0], table[:, 1], color=color, label=name)
    axes.set(xlabel="speed [m/s]", ylabel="friction force [N]")
    axes.legend(frameon=False)
    axes.grid(alpha=0.3)
    return figure


def steps_table(found: Mapping[str, Any]) -> Table:
    """Return the accepted effects with parameters, evidence and errors."""
    header = ("effect", "parameters", "p (Holm)", "error after", "held-out error after", "not distinguishable from")
    rows = []
    for step in found["steps"]:
        values = ", ".join(
            f"{symbol} = {value['value']:.4g} {value['unit']}".removesuffix(" 1")
            for symbol, value in step["parameters"].items()
        )
        after, held = (100.0 * step[k]["torque"]["relative"] for k in ("error_after", "holdout_after"))
        p = step["evidence"].get("p_holm")
        rows.append((
            step["effect"], values, "-" if p is None else probability(p), f"{after:.2f} %",
            f"{held:.2f} %", ", ".join(step["equivalents"]) or "-",
        ))  # fmt: skip
    return Table(header, tuple(rows))


def emps() -> None:
    """The measured axis, from results alone."""
    data = Path(os.environ.get("PMSM_CTRL_DATA", "../shared/data")) / "emps"
    design = Design.read("designs/emps.toml")
    try:
        log, pulses = (read_log(data / name, design) for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"))
    except Exception as error:
        print(f"emps: MEASURED DATA ABSENT, the page stays as it is: {error}", file=sys.stderr)
        return
    identified = identify(design, log)
    found = diagnose(design, log, holdout=pulses)
    plain = found.to_dict()
    first, last = (100.0 * found.errors[k]["torque"]["relative"] for k in ("base", "final"))
    held = [100.0 * k["torque"]["relative"]
            for k in (found.steps[0].holdout_before, found.steps[-1].holdout_after)]  # fmt: skip
    residual, smallest = binned(found)
    assert smallest >= 100, "a mean over fewer samples comes close to the data"
    sections = [_identified(identified), _missing(identified.design, found, plain), _origin()]
    text = render(
        "EMPS: a measured axis and its missing effects", sections,
        headline=Headline(
            "The public record of an electro-mechanical positioning system (ball screw, 25 s, 1 kHz) was identified "
            "and diagnosed; a second record, with pulses, was held out.",
            f"{len(found.steps)} effects are missing from the model of inertia, Coulomb and viscous friction and "
            "offset; the authors of the data found the first of them years later.",
            None,
            ((f"{first:.2f} to {last:.2f} %", "force error before and after: rms of measured less predicted, by the "
              "rms of the measured"),
             (f"{held[0]:.2f} to {held[1]:.2f} %", "the same on the held-out record, to which nothing was fitted"),
             ("3.11 %", "the same of the authors' extended model")),
            (Picture(lambda: falling_figure(found), "Every accepted effect lowers the error on both records."),
             Picture(
                lambda: residual,
                f"Mean residual in 14 bins of speed, {smallest} samples and more each: as identified, the model is "
                "wrong by up to 3 N, depending on speed and direction; with the missing effects the mean is zero.",
             )),
        ),
        notices=found.notices, design_toml=design.to_toml(), command=command("emps"),
        facts={"log, SHA-256": log.provenance.sha256, "holdout, SHA-256": pulses.provenance.sha256,
               "design": design.source},
    )  # fmt: skip
    write_text(GALLERY / "emps.html", text)


def _identified(identified: Any) -> Section:
    """Published values and those of the regression."""
    published = {"J": ("moving mass M", 95.11), "F_v": ("viscous friction F_v", 203.5),
                 "F_c": ("Coulomb friction F_c", 20.39), "T_0": ("offset", -3.16)}  # fmt: skip
    rows = []
    for symbol, (name, value) in published.items():
        e = identified.estimates[symbol]
        rows.append((name, f"{e.value:.4g}", f"{e.stderr:.2g}", f"{value:.4g}", e.unit))
    return Section(
        "Parameters that the authors published",
        (
            "Inverse-dynamics regression on the first record, and the values of Janot, Gautier and Brunot (2019).",
            Table(("", "this page", "standard error", "the authors", "unit"), tuple(rows)),
        ),
    )


def _missing(identified: Design, found: Diagnosis, plain: Mapping[str, Any]) -> Section:
    """Errors of the steps, and the two friction models."""
    return Section(
        "Missing effects",
        (
            "Each effect was accepted by a test corrected for all candidates, by its cross-validation gain, and on the "
            "second record. Nothing was fitted to that record.",
            steps_table(plain),
            Picture(
                lambda: friction_curves(identified, found.design),
                "Friction of both models: the slopes differ between the directions, and near standstill friction is "
                "lower than a straight line, as in presliding.",
            ),
        ),
    )


def _origin() -> Section:
    return Section(
        "Where the data comes from",
        ("A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, Nonlinear System Identification "
         "Benchmarks workshop, 2019. The measured data is not part of this project, and this page holds none of it: "
         "tables, models, and means over bins.",),
    )  # fmt: skip


CASES: Mapping[str, Callable[[], None]] = {
    case.__name__: case for case in (reference_experiment, emps, hidden_effects, compensation)
}


def main(names: list[str]) -> None:
    """Write the named pages, or all."""
    os.chdir(ROOT)
    GALLERY.mkdir(parents=True, exist_ok=True)
    unknown = [name for name in names if name not in CASES]
    if unknown:
        raise SystemExit(f"{unknown[0]}: no such page; one of {', '.join(CASES)}")
    for name in names or CASES:
        CASES[name]()
        print(f"{GALLERY / name}.html")


if __name__ == "__main__":
    main(sys.argv[1:])
