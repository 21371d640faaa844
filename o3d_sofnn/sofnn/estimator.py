"""The self-organized fuzzy neural network as a regressor: section 3 of the paper."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from o3d_sofnn.sofnn.neurons import Array, Neurons, firing_strength, infer
from o3d_sofnn.sofnn.offline import LearningOptions, TypicalData, learn
from o3d_sofnn.sofnn.one_thread import on_one_thread
from o3d_sofnn.sofnn.online import OnlineState, first_rule, first_state, observe
from o3d_sofnn.sofnn.sklearn_api import Regressor, check_outputs
from o3d_sofnn.sofnn.standardization import Moments, Scaling

_CONSEQUENTS = ("constant", "linear")


class SOFNN(Regressor):
    """Self-organized fuzzy neural network: regression by IF-THEN rules it finds itself.

    A rule is an elliptical Gaussian neuron. `fit` learns off-line: fuzzy c-means reduces the
    data to typical data, neurons are generated on them from coarse to fine and combined,
    and all parameters are adjusted by gradient. `partial_fit` learns on-line, one
    observation at a time, and may be called first or after `fit`.

    Parameters
    ----------
    tolerance : float, default 0.05
        System error above which a neuron may be generated, in standard deviations of `y`.
        The noise level, measured from the data, is used where it is larger.
    boundary : float, default 0.05
        Accommodation boundary: smallest distance of a new neuron to the others, in standard
        deviations of the inputs.
    overlap : float, default 1.1
        Width of a new neuron divided by its distance to the nearest one: `k` of equation (10),
        in [1.06, 1.2].
    similarity : float, default 0.8
        Similarity of membership functions, in [0, 1], above which neurons may be combined; they
        are combined if the data do not distinguish them.
    n_typical : int or None, default None
        Number of typical data; None takes a third of the rows, at most 200.
    fuzziness : float, default 2.0
        Smoothing weight of fuzzy c-means, greater than 1.
    max_rules : int, default 200
        Largest number of rules.
    consequent : {'constant', 'linear'}, default 'constant'
        'constant' is the paper's singleton per rule; 'linear' adds a slope, and so needs
        fewer rules where the function is close to linear.
    adjust_steps : int, default 200
        Gradient steps of the last off-line adjustment.
    memory : int, default 1000
        Number of observations that on-line learning keeps to adjust centres and widths on.
    random_state : int, default 0
        Seed; equal data and seed give equal rules.

    Attributes
    ----------
    centers_ : (M, d) array
        Centres of the membership functions, in the units of the inputs.
    widths_ : (M, d) array
        Standard deviations of the membership functions.
    theta_ : (m, M) array
        Consequents, the adjustable parameter matrix of equation (8).
    slopes_ : (m, M, d) array or None
        Slopes of linear consequents.
    rules_ : list of str
        The rules as text.
    n_rules_, n_features_in_, n_outputs_ : int
        Numbers M, d and m.
    typical_data_ : (c, d + m) array
        Typical data of the last `fit`, inputs before outputs.

    Raises
    ------
    ValueError
        From `fit` and `partial_fit`, if a parameter is out of range or the data are not finite
        arrays of matching shape; from `predict`, also before either was called.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(0.0, 1.0, 200)[:, None]
    >>> model = SOFNN().fit(x, np.sin(6.0 * x[:, 0]))
    >>> bool(abs(model.predict([[0.5]])[0] - np.sin(3.0)) < 0.02)
    True
    """

    _neurons: Neurons
    _state: OnlineState
    _rng: np.random.Generator
    _flat: bool
    typical_data_: Array

    def __init__(
        self,
        *,
        tolerance: float = 0.05,
        boundary: float = 0.05,
        overlap: float = 1.1,
        similarity: float = 0.8,
        n_typical: int | None = None,
        fuzziness: float = 2.0,
        max_rules: int = 200,
        consequent: str = "constant",
        adjust_steps: int = 200,
        memory: int = 1000,
        random_state: int = 0,
    ) -> None:
        self.tolerance = tolerance
        self.boundary = boundary
        self.overlap = overlap
        self.similarity = similarity
        self.n_typical = n_typical
        self.fuzziness = fuzziness
        self.max_rules = max_rules
        self.consequent = consequent
        self.adjust_steps = adjust_steps
        self.memory = memory
        self.random_state = random_state

    @on_one_thread
    def fit(self, X: ArrayLike, y: ArrayLike) -> SOFNN:
        """Learn off-line from inputs `X` (n, d) and outputs `y` (n,) or (n, m), from scratch."""
        self._check_parameters()
        x, wanted = self._check_data(X, y, first=True)
        options = self._options(x.shape[1])
        self._rng = np.random.default_rng(self.random_state)
        scaling = Scaling.of(Moments.of(x), Moments.of(wanted))
        neurons, typical = learn(scaling.inputs(x), scaling.outputs(wanted), options, self._rng)
        self._neurons = scaling.restore(neurons)
        self.typical_data_ = _unscaled(typical, scaling)
        self._state = first_state(self._neurons, x, wanted, options, self._rng)
        return self

    @on_one_thread
    def partial_fit(self, X: ArrayLike, y: ArrayLike) -> SOFNN:
        """Learn on-line from the rows of `X` (n, d) and `y` (n,) or (n, m), one after the other."""
        self._check_parameters()
        first = not self.__sklearn_is_fitted__()
        x, wanted = self._check_data(X, y, first=first)
        options = self._options(x.shape[1])
        start = 0
        if first:
            self._rng = np.random.default_rng(self.random_state)
            self._neurons = first_rule(x[0], wanted[0], options.n_terms)
            self._state = first_state(self._neurons, x[:1], wanted[:1], options, self._rng)
            start = 1
        elif not hasattr(self, "_state"):
            self._rng = np.random.default_rng(self.random_state)
            self._state = first_state(self._neurons, x, wanted, options, self._rng)
        for row in range(start, len(x)):
            self._neurons = observe(
                self._neurons, self._state, x[row], wanted[row], options, self._rng
            )
        return self

    def predict(self, X: ArrayLike) -> Array:
        """Give the outputs at the rows of `X` (n, d): (n,), or (n, m) if `y` had columns.

        Defined everywhere: far from all rules, the relatively nearest one answers.
        """
        self._check_fitted()
        y = infer(self._check_inputs(X, first=False), self._neurons)
        return y[:, 0] if self._flat else y

    def support(self, X: ArrayLike) -> Array:
        """Give the (n,) largest firing strength at the rows of `X`: 1 at a centre, 0 far away."""
        self._check_fitted()
        return firing_strength(self._check_inputs(X, first=False), self._neurons)

    def restore(self, neurons: Neurons) -> SOFNN:
        """Use rules of one output that were learned elsewhere."""
        self.n_features_in_, self.n_outputs_, self._flat = neurons.centers.shape[1], 1, True
        self.consequent = "constant" if len(neurons.coefficients) == 1 else "linear"
        self._neurons = neurons
        return self

    @property
    def centers_(self) -> Array:
        """Centres of the membership functions, (M, d)."""
        self._check_fitted()
        return self._neurons.centers

    @property
    def widths_(self) -> Array:
        """Standard deviations of the membership functions, (M, d)."""
        self._check_fitted()
        return self._neurons.widths

    @property
    def theta_(self) -> Array:
        """Consequents: the parameter matrix of equation (8), (m, M)."""
        self._check_fitted()
        theta: Array = self._neurons.coefficients[0].T  # Eq. (8)
        return theta

    @property
    def slopes_(self) -> Array | None:
        """Slopes of linear consequents in output per input unit, (m, M, d); None if constant."""
        self._check_fitted()
        if len(self._neurons.coefficients) == 1:
            return None
        per_width = np.transpose(self._neurons.coefficients[1:], (2, 1, 0))
        slopes: Array = per_width / self._neurons.widths
        return slopes

    @property
    def n_rules_(self) -> int:
        """Number of rules."""
        self._check_fitted()
        return len(self._neurons)

    @property
    def rules_(self) -> list[str]:
        """The rules as text, one per neuron."""
        self._check_fitted()
        d = self.n_features_in_
        inputs = list(getattr(self, "feature_names_in_", [f"x{i}" for i in range(d)]))
        outputs = ["y"] if self._flat else [f"y{i}" for i in range(self.n_outputs_)]
        slopes = self.slopes_
        rules = []
        for j, (center, width) in enumerate(zip(self.centers_, self.widths_, strict=True)):
            premises = [
                f"{name} is about {c:.4g} (± {w:.2g})"
                for name, c, w in zip(inputs, center, width, strict=True)
            ]
            conclusions = []
            for k, name in enumerate(outputs):
                text = f"{name} is {self.theta_[k, j]:.4g}"
                if slopes is not None:
                    text += "".join(
                        f" {'-' if slope < 0 else '+'} {abs(slope):.4g} ({of} - {c:.4g})"
                        for slope, of, c in zip(slopes[k, j], inputs, center, strict=True)
                    ).replace("- -", "+ ")
                conclusions.append(text)
            rules.append(f"IF {' AND '.join(premises)} THEN {' AND '.join(conclusions)}")
        return rules

    def __sklearn_is_fitted__(self) -> bool:
        """Return whether there are rules."""
        return hasattr(self, "_neurons")

    def _check_data(self, X: ArrayLike, y: ArrayLike, *, first: bool) -> tuple[Array, Array]:
        x = self._check_inputs(X, first=first)
        wanted = check_outputs(y, len(x))
        if first:
            self._remember_columns(X, x.shape[1])
            self.n_outputs_ = wanted.shape[1]
            self._flat = np.asarray(y).ndim == 1
        elif wanted.shape[1] != self.n_outputs_:
            raise ValueError(f"y: expected {self.n_outputs_} columns, got {wanted.shape[1]}")
        return x, wanted

    def _check_parameters(self) -> None:
        _check_number("tolerance", self.tolerance, 0.0, np.inf)
        _check_number("boundary", self.boundary, 0.0, np.inf)
        _check_number("overlap", self.overlap, 1.06, 1.2, closed=True)
        _check_number("similarity", self.similarity, 0.0, 1.0, closed=True)
        _check_number("fuzziness", self.fuzziness, 1.0, np.inf)
        _check_count("max_rules", self.max_rules, 1)
        _check_count("adjust_steps", self.adjust_steps, 1)
        _check_count("memory", self.memory, 20)
        if self.n_typical is not None:
            _check_count("n_typical", self.n_typical, 2)
        if self.consequent not in _CONSEQUENTS:
            raise ValueError(f"consequent: expected one of {_CONSEQUENTS}, got {self.consequent!r}")

    def _options(self, n_features: int) -> LearningOptions:
        return LearningOptions(
            tolerance=self.tolerance,
            boundary=self.boundary,
            overlap=self.overlap,
            similarity=self.similarity,
            n_typical=self.n_typical,
            fuzziness=self.fuzziness,
            max_rules=self.max_rules,
            n_terms=1 if self.consequent == "constant" else 1 + n_features,
            max_iter=self.adjust_steps,
            memory=self.memory,
        )


def _unscaled(typical: TypicalData, scaling: Scaling) -> Array:
    x = typical.x * scaling.x_scale + scaling.x_mean
    return np.hstack([x, typical.y * scaling.y_scale + scaling.y_mean])


def _check_number(name: str, value: Any, low: float, high: float, *, closed: bool = False) -> None:
    number = isinstance(value, (int, float, np.integer, np.floating)) and np.isfinite(value)
    if not number or not (low <= value <= high if closed else low < value < high):
        bounds = f"[{low:g}, {high:g}]" if closed else f"({low:g}, {high:g})"
        raise ValueError(f"{name}: expected a number in {bounds}, got {value!r}")


def _check_count(name: str, value: Any, low: int) -> None:
    if not isinstance(value, (int, np.integer)) or value < low:
        raise ValueError(f"{name}: expected an integer >= {low}, got {value!r}")
