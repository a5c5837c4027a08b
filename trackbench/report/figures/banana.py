"""Figure kinds of the banana: `banana` and `posterior`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.random import Generator

from trackbench.config.component_as_config import as_config
from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.polar_conversions import Conversion, Polar, convert, position
from trackbench.core.random_streams import block_stream
from trackbench.field_types import Count, Positive
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.platform import Platform
from trackbench.registry import register
from trackbench.report.findings import grid_headings
from trackbench.report.findings.phrases import listed, named
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import filter_colors, style
from trackbench.report.plotting.panels import add_title_and_legend
from trackbench.report.plotting.scales import length_unit
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.plotting.tick_labels import with_true_minus
from trackbench.report.tables_and_figures import Results

_SIMILAR = 4.0
"""Ratio of height and width up to which both axes have equal scales."""


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

    def default_caption(self, results: Results) -> str:
        """Return the noise, and which conversions are drawn."""
        caption = (
            f"Samples of the target's position, given its range and azimuth with standard deviations of "
            f"{self.sigma_range:g} m and {self.sigma_azimuth_mrad:g} mrad, seen along the line of sight."
        )
        if self.conversions:
            names = listed([conversion.upper() for conversion in self.conversions])
            caption += f" The ellipses are 1 and 2 standard deviations of {names}."
        return caption

    def draw(self, results: Results) -> Figure:
        """Return a panel per range."""
        # 2.9 inches high.
        figure, axes = style.subplots(1, len(self.ranges_km), 2.9, squeeze=False)
        # The stream is that of a filter's noise in the first block.
        rng = block_stream(results.config["seed"], block=0)
        for ax, range_km in zip(axes[0], self.ranges_km, strict=True):
            self._draw_panel(ax, range_km, rng)
        axes[0][0].set_ylabel("Along it, less the range (m)")
        return add_title_and_legend(figure, self.title)

    def _draw_panel(self, ax: Axes, range_km: float, rng: Generator) -> None:
        """Draw samples of the target, and ellipses of each conversion of the measurement.

        The target was measured at the range ``range_km`` and the azimuth 0. The horizontal axis is
        across the line of sight, in km. The vertical axis is along it, in m from the measured position.
        """
        from matplotlib.ticker import FuncFormatter, MaxNLocator

        sigma_azimuth = 1e-3 * self.sigma_azimuth_mrad
        measurement = Polar(
            r=np.array([1e3 * range_km]),
            a=np.array([0.0]),
            range_variance=self.sigma_range**2,
            azimuth_variance=sigma_azimuth**2,
        )
        # Step 1: samples of the position. At azimuth 0 the line of sight is the first axis.
        ranges = measurement.r + self.sigma_range * rng.standard_normal(self.samples)
        azimuths = sigma_azimuth * rng.standard_normal(self.samples)
        along, across = position(ranges, azimuths)
        ax.plot(
            1e-3 * across,
            along - measurement.r,
            ".",
            markersize=1.2,
            color="#999999",
            label="Samples",
            rasterized=True,
        )
        # Step 2: ellipses of one and two standard deviations.
        for number, conversion in enumerate(self.conversions):
            converted = convert(conversion, measurement)
            mean = converted.mean[:, 0] - [measurement.r[0], 0.0]
            look = {"label": f"{conversion.upper()}, 1 and 2 σ", **filter_colors.line(number)}
            for deviations in (1, 2):
                along, across = ellipse(mean, converted.cov[..., 0], deviations)
                ax.plot(1e-3 * across, along, **look)
        # Step 3: labels; fewer ticks where panels are narrow.
        panels = len(self.ranges_km)
        ax.set_title(f"{range_km:g} km")
        ax.set_xlabel(style.wrapped("Across the line of sight (km)", panels))
        most_ticks = 4 if panels < 4 else 2
        ax.xaxis.set_major_locator(MaxNLocator(most_ticks, steps=[1, 2, 5, 10]))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: with_true_minus(f"{x:g}")))


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
    half_height_m: Positive | None = None
    """half the height of the panel, m; default: the panel shows all that is drawn"""
    predicted: str | None = None
    """label of a filter whose prediction from the step before is drawn, too"""
    label_keys: ClassVar[tuple[str, ...]] = ("predicted",)
    numbers: ClassVar[tuple[str, ...]] = ("run",)
    shown_covariances = True

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Require a radar measurement at the point and step.

        Return the reason by key, ``""`` for the figure as a whole; empty if all is well.
        """
        if self.point > len(points):
            return {"point": f"{self.point} is more than the number of points, {len(points)}"}
        point = points[self.point - 1]
        scenario = as_config(point.scenario, str)
        if _kind(scenario) != "tracking" or _kind(scenario["sensor"]) != "range-azimuth":
            return {"": "there is no range and azimuth to show"}
        motion = _kind(scenario["target"].get("motion"))
        # `predicted` names a filter whose prediction is drawn. `predicted_position` computes it with the
        # transition of white noise acceleration (cwna).
        if self.predicted is not None and motion != "cwna":
            return {"predicted": "the motion is not white noise acceleration"}
        # The first step has the initial state and no measurement.
        first_measured = point.scenario.steps[1]
        last = point.scenario.steps[-1]
        if not first_measured <= self.step <= last:
            return {"step": f"{self.step} is not one of the steps {first_measured} to {last}"}
        return {}

    def default_caption(self, results: Results) -> str:
        """Return what is drawn: the run, the step and the filters."""
        labels = listed([named(label) for label in results.chosen(self.filters)])
        # The number counts all points of the grid, also those where every filter failed.
        where = grid_headings.at_point(results.grid_points[self.point - 1])
        return (
            f"Run {self.run}, step {self.step}{where}: the 2-sigma ellipses of {labels} around the true "
            "target, and the region of the measurement."
        )

    def draw(self, results: Results) -> Figure:
        """Return the region of the measurement, and an ellipse per filter, up to two sigma."""
        figure, ax = style.subplots(height_in=3.4)
        point = results.grid_points[self.point - 1]
        tracks = results.tracks(point)
        if tracks:  # not every filter failed here
            self._draw_panel(ax, tracks, results, results.facts(point).scenario)
        return add_title_and_legend(figure, self.title)

    def _draw_panel(
        self, ax: Axes, tracks: dict[str, Array], results: Results, scenario: dict[str, Any]
    ) -> None:
        """Draw measurement, prediction and posteriors, seen from the true target.

        The state is px, vx, py, vy. ``tracks`` are those of `Results.tracks` at the point, with the axes
        (component, step, run). The first step has no measurement, so that the measurement of the step at
        index k has the index k - 1.
        """
        k = int(np.flatnonzero(tracks["steps"] == self.step)[0])
        run = self.run - 1
        sensor = scenario["sensor"]
        sensor_place = _place_of_sensor(sensor, self.step)
        view = _View.between(sensor_place, tracks["truth"][[0, 2], k, run])
        # Step 1: outlines (2, n) along and across the line of sight, m.
        z = tracks["measurements"][:, k - 1, run]
        measured = _measured_region(z, view, sensor, sensor_place)
        predicted: list[Array] = []
        if f"cov/{self.predicted}" in tracks:
            posterior_before = Gaussian(
                tracks[f"mean/{self.predicted}"][..., k - 1, run],
                tracks[f"cov/{self.predicted}"][..., k - 1, run],
            )
            predicted.append(view.ellipse_of(predicted_position(posterior_before, scenario)))
        labels = [label for label in results.chosen(self.filters) if f"cov/{label}" in tracks]
        ellipses: dict[str, Array] = {}
        for label in labels:
            mean = tracks[f"mean/{label}"][[0, 2], k, run]
            cov = tracks[f"cov/{label}"][np.ix_([0, 2], [0, 2])][..., k, run]
            ellipses[label] = view.ellipse_of(Gaussian(mean, cov))
        # Step 2: units of the two axes, which may differ. All outlines and the target at the origin are
        # within the panel, with a margin.
        outlines = np.concatenate(
            [measured, *predicted, *ellipses.values(), np.zeros((2, 1))], axis=1
        )
        half_height = self.half_height_m or 1.05 * float(np.nanmax(np.abs(outlines[0])))
        # What is above or below the panel takes no room beside it.
        across_shown = outlines[1, np.abs(outlines[0]) <= half_height]
        left = float(np.nanmin(across_shown))
        right = float(np.nanmax(across_shown))
        margin = 0.05 * (right - left)
        half_width = 0.5 * (right - left) + margin
        along_m, along_unit = length_unit(2.0 * half_height)
        across_m, across_unit = length_unit(2.0 * half_width)
        # Step 3: regions, and the target at the origin.
        along, across = measured
        look: LineStyle = {"color": "#999999", "alpha": 0.6, "lw": 0.8}
        ax.fill(across / across_m, along / along_m, label="Measurement, 2 σ", **look)
        for along, across in predicted:
            look = {"color": "#c9b26b", "alpha": 0.35, "lw": 0}
            ax.fill(across / across_m, along / along_m, label="Predicted, 2 σ", **look)
        ax.plot(0.0, 0.0, "k+", label="Target")
        looks = results.line_styles(labels)
        for label, (along, across) in ellipses.items():
            ax.plot(across / across_m, along / along_m, label=f"{label}, 2 σ", **looks[label])
        # Step 4: axes; where both have similar lengths, with equal scales.
        ax.set_ylim(-half_height / along_m, half_height / along_m)
        ax.set_xlim((left - margin) / across_m, (right + margin) / across_m)
        ratio = half_height / half_width
        if along_unit == across_unit and 1.0 / _SIMILAR < ratio < _SIMILAR:
            ax.set_aspect("equal", adjustable="box")
        ax.set_xlabel(f"Across the line of sight ({across_unit})")
        ax.set_ylabel(f"Along it ({along_unit})")


@dataclass(frozen=True, kw_only=True)
class _View:
    """Coordinates along and across the line of sight, with the true target as origin."""

    target: Array
    """position (2,), m"""
    rotation: Array
    """from x and y to along and across, (2, 2)"""

    @classmethod
    def between(cls, sensor_place: Array, target: Array) -> "_View":
        """Return the view from the place of the sensor (2,) toward a target (2,), m."""
        px, py = target - sensor_place
        azimuth = np.arctan2(py, px)
        c = np.cos(azimuth)
        s = np.sin(azimuth)
        return cls(target=target, rotation=np.array([[c, s], [-s, c]]))

    def transform(self, positions: Array) -> Array:
        """Return positions (2, n) along and across the line of sight."""
        return np.asarray(self.rotation @ (positions - self.target[:, None]))

    def ellipse_of(self, gaussian: Gaussian) -> Array:
        """Return the 2-sigma ellipse (2, 201) of a position along and across the line of sight.

        ``gaussian`` is the distribution of x and y.
        """
        mean = self.rotation @ (gaussian.mean - self.target)
        cov = self.rotation @ gaussian.cov @ self.rotation.T
        return ellipse(mean, cov, 2.0)


def _place_of_sensor(sensor: dict[str, Any], step: int) -> Array:
    """Return the place (2,) at a step, m, of the sensor with these keys."""
    if sensor.get("platform") is not None:
        return np.array(Platform(**sensor["platform"]).place(step))
    return np.array(sensor.get("at") or (0.0, 0.0))


def _measured_region(z: Array, view: _View, sensor: dict[str, Any], sensor_place: Array) -> Array:
    """Return the outline of the region within two sigma of a measurement.

    ``z`` (2,) is its range, m, and azimuth, rad. ``sensor`` has the keys of the sensor, which is at
    ``sensor_place`` (2,), m. The outline (2, 402) is along and across the line of sight, m.
    """
    half_width = 2.0 * 1e-3 * sensor["sigma_azimuth_mrad"]  # two sigma, rad
    azimuths = z[1] + half_width * np.linspace(-1.0, 1.0, 201)
    near_ranges = np.full(201, z[0] - 2.0 * sensor["sigma_range"])
    far_ranges = np.full(201, z[0] + 2.0 * sensor["sigma_range"])
    near = view.transform(sensor_place[:, None] + position(near_ranges, azimuths))
    far = view.transform(sensor_place[:, None] + position(far_ranges, azimuths))
    # Along the near arc, and back along the far one.
    return np.concatenate([near, far[:, ::-1]], axis=1)


def _kind(component: Any) -> str | None:
    """Return the ``kind`` of a component with these keys; None for a list of sensors, and for None."""
    if not isinstance(component, dict):
        return None
    return component.get("kind")


def predicted_position(posterior: Gaussian, scenario: dict[str, Any]) -> Gaussian:
    """Return the distribution of x and y one scan after a posterior of px, vx, py, vy.

    Parameters
    ----------
    posterior
        mean (4,) and covariance (4, 4), in m and m/s
    scenario
        keys of the scenario. Its motion is white noise acceleration

    Returns
    -------
    Gaussian
        mean (2,) and covariance (2, 2), in m
    """
    motion = WhiteAcceleration(q=scenario["target"]["motion"]["q"]).sampled(scenario["T"])
    # F m and Q; nothing depends on the step, here 0.
    moved = motion.transition(posterior.mean, 0)
    cov = motion.F @ posterior.cov @ motion.F.T + moved.cov
    return Gaussian(moved.mean[0::2], cov[0::2, 0::2])


def ellipse(mean: Array, cov: Array, deviations: float) -> Array:
    """Return points (2, 201) of the curve of constant density, ``deviations`` sigma from the mean.

    ``mean`` (2,) and ``cov`` (2, 2) are those of a Gaussian.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 201)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(mean[:, None] + deviations * _root(cov) @ circle)


def _root(cov: Array) -> Array:
    """Return a matrix (2, 2) A with A A' = cov, also of a covariance that is singular by rounding."""
    try:
        return np.asarray(np.linalg.cholesky(cov))
    except np.linalg.LinAlgError:
        variances, axes = np.linalg.eigh(cov)
        return np.asarray(axes * np.sqrt(np.maximum(variances, 0.0)))
