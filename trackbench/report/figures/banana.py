"""Figure kinds of the banana: `banana` and `posterior`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from trackbench.config.dump import as_config
from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.core.conversions import Conversion, Polar, convert, position
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import block_stream
from trackbench.field_types import Count, Positive
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.registry import register
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.results import Results


@register("figures", "banana")
@dataclass(frozen=True, kw_only=True)
class Banana(FigureKind):
    """Region of a target given its range and azimuth, and the Gaussians of the conversions.

    Draws its own samples, from the experiment's seed. Axes run along and across the line of sight.
    """

    ranges_km: tuple[Positive, ...]
    """measured ranges, a panel each"""
    sigma_range: Positive = 0.2
    """standard deviation of the range, m"""
    sigma_azimuth_mrad: Positive = 2.0
    """standard deviation of the azimuth, mrad"""
    conversions: tuple[Conversion, ...] = ()
    """conversions whose 1- and 2-sigma ellipses are drawn"""
    samples: Count = 3000
    """number of points"""

    def draw(self, results: Results) -> Figure:
        """Return a panel per range."""
        from matplotlib.ticker import FuncFormatter, MaxNLocator

        figure, axes = style.subplots(1, len(self.ranges_km), 2.9, squeeze=False)
        rng = block_stream(results.config["seed"], 0)
        for ax, range_km in zip(axes[0], self.ranges_km, strict=True):
            variances = self.sigma_range**2, (1e-3 * self.sigma_azimuth_mrad) ** 2
            z = Polar(np.array([1e3 * range_km]), np.array([0.0]), *variances)
            r = z.r + self.sigma_range * rng.standard_normal(self.samples)
            a = 1e-3 * self.sigma_azimuth_mrad * rng.standard_normal(self.samples)
            along, across = position(r, a)
            ax.plot(
                1e-3 * across, along - z.r, ".", markersize=1.2, color="#999999", label="Samples",
                rasterized=True,
            )  # fmt: skip
            for i, conversion in enumerate(self.conversions):
                converted = convert(conversion, z)
                mean = converted.mean[:, 0] - [z.r[0], 0.0]
                look = {"label": f"{conversion.upper()}, 1 and 2 σ", **style.line(i)}
                for deviations in (1, 2):
                    along, across = ellipse(mean, converted.cov[..., 0], deviations)
                    ax.plot(1e-3 * across, along, **look)
            ax.set_title(f"{range_km:g} km")
            ax.set_xlabel(style.wrapped("Across the line of sight (km)", len(self.ranges_km)))
            few = 4 if len(self.ranges_km) < 4 else 2
            ax.xaxis.set_major_locator(MaxNLocator(few, steps=[1, 2, 5, 10]))
            ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axes[0][0].set_ylabel("Along it, less the range (m)")
        return style.add_title_and_legend(figure, self.title)


@register("figures", "posterior")
@dataclass(frozen=True, kw_only=True)
class PosteriorEllipses(FigureKind):
    """One run's measurement and the filters' 2-sigma ellipses at one step, seen from the true target."""

    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""
    run: Count = 1
    """number of the run, from 1"""
    step: Count = 3
    """number of the step, as the horizontal axes of other figures count it"""
    point: Count = 1
    """number of the grid's point, from 1"""
    half_height_m: Positive = 20.0
    """half the height of the panel, m"""
    predicted: str | None = None
    """label of a filter whose prediction from the step before is drawn, too"""
    label_keys: ClassVar[tuple[str, ...]] = ("predicted",)
    numbers: ClassVar[tuple[str, ...]] = ("run",)
    shown_covariances = True

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Require a radar measurement at the point and step."""
        if self.point > len(points):
            return {"point": f"{self.point} is more than the number of points, {len(points)}"}
        point = points[self.point - 1]
        scenario = as_config(point.scenario, str)
        if _kind(scenario) != "tracking" or _kind(scenario["sensor"]) != "range-azimuth":
            return {"": "there is no range and azimuth to show"}
        driven_by = _kind(scenario["target"].get("motion"))
        if self.predicted is not None and driven_by != "cwna":
            return {"predicted": "the motion is not white noise acceleration"}
        first, last = point.scenario.steps[1], point.scenario.steps[-1]
        if not first <= self.step <= last:
            return {"step": f"{self.step} is not one of the steps {first} to {last}"}
        return {}

    def draw(self, results: Results) -> Figure:
        """Return the measurement's arc of two standard deviations, and an ellipse per filter."""
        figure, ax = style.subplots(height_in=3.4)
        point = results.grid_points[self.point - 1]
        tracks = results.tracks(point)
        if tracks:  # not every filter failed here
            self._panel(ax, tracks, results, results.facts(point).scenario)
        ax.set_xlabel("Across the line of sight (km)")
        ax.set_ylabel("Along it (m)")
        ax.set_ylim(-self.half_height_m, self.half_height_m)
        return style.add_title_and_legend(figure, self.title)

    def _panel(
        self, ax: Axes, tracks: dict[str, Array], results: Results, scenario: dict[str, Any]
    ) -> None:
        k, m = int(np.flatnonzero(tracks["steps"] == self.step)[0]), self.run - 1
        truth = tracks["truth"][[0, 2], k, m]
        z = tracks["measurements"][:, k - 1, m]
        a = np.arctan2(truth[1], truth[0])
        frame = np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
        self._arc(ax, z, truth, frame, scenario)
        if f"cov/{self.predicted}" in tracks:
            before = [tracks[f"{part}/{self.predicted}"][..., k - 1, m] for part in ("mean", "cov")]
            region = predicted_position(Gaussian(*before), scenario)
            along, across = ellipse(
                frame @ (region.mean - truth), frame @ region.cov @ frame.T, 2.0
            )
            ax.fill(1e-3 * across, along, color="#c9b26b", alpha=0.35, lw=0, label="Predicted, 2 σ")
        ax.plot(0.0, 0.0, "k+", label="Target")
        for label in results.chosen(self.filters):
            if f"cov/{label}" not in tracks:
                continue
            mean = tracks[f"mean/{label}"][[0, 2], k, m]
            cov = tracks[f"cov/{label}"][np.ix_([0, 2], [0, 2])][..., k, m]
            along, across = ellipse(frame @ (mean - truth), frame @ cov @ frame.T, 2.0)
            ax.plot(1e-3 * across, along, label=f"{label}, 2 σ", **results.line_style(label))

    def _arc(self, ax: Any, z: Array, truth: Array, frame: Array, scenario: Any) -> None:
        sensor, edges = scenario["sensor"], []
        azimuths = z[1] + 2e-3 * sensor["sigma_azimuth_mrad"] * np.linspace(-1.0, 1.0, 201)
        for side in (-2.0, 2.0):
            ranges = np.full(201, z[0] + side * sensor["sigma_range"])
            edges.append(frame @ (position(ranges, azimuths) - truth[:, None]))
        ax.fill_between(
            1e-3 * edges[0][1], edges[0][0], edges[1][0], color="#999999", alpha=0.6, lw=0.8,
            label="Measurement, 2 σ",
        )  # fmt: skip


def _kind(part: Any) -> str | None:
    """Read the kind of a part in plain data; None of several sensors, and of none."""
    return part.get("kind") if isinstance(part, dict) else None


def predicted_position(before: Gaussian, scenario: dict[str, Any]) -> Gaussian:
    """Return the position (2,) one scan after a state (4,), under the scenario's motion."""
    motion = WhiteAcceleration(q=scenario["target"]["motion"]["q"]).sampled(scenario["T"])
    moved = motion.transition(before.mean, 0)
    cov = motion.F @ before.cov @ motion.F.T + moved.cov
    return Gaussian(moved.mean[0::2], cov[0::2, 0::2])


def ellipse(mean: Array, cov: Array, deviations: float) -> Array:
    """Return points (2, 201) of the curve of constant density that many standard deviations out."""
    angle = np.linspace(0.0, 2.0 * np.pi, 201)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(mean[:, None] + deviations * _root(cov) @ circle)


def _root(cov: Array) -> Array:
    """Factor a covariance (2, 2), which may be singular but for rounding."""
    try:
        return np.asarray(np.linalg.cholesky(cov))
    except np.linalg.LinAlgError:
        variances, axes = np.linalg.eigh(cov)
        return np.asarray(axes * np.sqrt(np.maximum(variances, 0.0)))
