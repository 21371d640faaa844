"""The scikit-learn protocol for a regressor, without importing scikit-learn."""

from __future__ import annotations

import inspect
import sys
import warnings
from abc import ABC, abstractmethod
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from o3d_sofnn.sofnn.neurons import Array

Self = TypeVar("Self", bound="Regressor")


class NotFittedError(ValueError, AttributeError):
    """Raised where a fitted model is needed; scikit-learn's own class is used if it is loaded."""


class Regressor(ABC):
    """Parameters, checks and score that scikit-learn expects of a regressor.

    A subclass stores the arguments of its constructor under their names.
    """

    n_features_in_: int
    n_outputs_: int
    feature_names_in_: Any

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Give the constructor's parameters by name; `deep` is accepted for compatibility."""
        return {name: getattr(self, name) for name in _defaults(type(self))}

    def set_params(self: Self, **params: Any) -> Self:
        """Change parameters by name and return the model.

        Raises
        ------
        ValueError
            If there is no such parameter.
        """
        known = _defaults(type(self))
        for name, value in params.items():
            if name not in known:
                raise ValueError(
                    f"{name}: expected a parameter of {type(self).__name__} "
                    f"({', '.join(known)}), got an unknown name"
                )
            setattr(self, name, value)
        return self

    def score(self, X: ArrayLike, y: ArrayLike) -> float:
        """Give the coefficient of determination R², averaged over outputs; 1 is perfect.

        An output that does not vary scores 1 if predicted exactly, else 0.
        """
        predicted = np.asarray(self.predict(X))
        wanted = check_outputs(y, len(predicted))
        error = np.sum((predicted.reshape(wanted.shape) - wanted) ** 2, axis=0)
        spread = np.sum((wanted - wanted.mean(axis=0)) ** 2, axis=0)
        varies = spread > 0.0
        share = np.divide(error, spread, out=np.where(error > 0.0, 1.0, 0.0), where=varies)
        return float(np.mean(1.0 - share))

    @abstractmethod
    def predict(self, X: ArrayLike) -> Array:
        """Give the outputs at the rows of `X`."""

    def __repr__(self) -> str:
        """Show the parameters that differ from their defaults, as scikit-learn does."""
        defaults = _defaults(type(self))
        changed = [
            f"{name}={value!r}"
            for name, value in self.get_params().items()
            if repr(value) != repr(defaults[name])
        ]
        return f"{type(self).__name__}({', '.join(changed)})"

    @abstractmethod
    def __sklearn_is_fitted__(self) -> bool:
        """Return whether the model can predict."""

    def __sklearn_tags__(self) -> Any:
        """Describe the model to scikit-learn."""
        from sklearn.utils import InputTags, RegressorTags, Tags, TargetTags

        return Tags(
            estimator_type="regressor",
            target_tags=TargetTags(required=True, multi_output=True),
            regressor_tags=RegressorTags(),
            input_tags=InputTags(),
        )

    def _check_fitted(self) -> None:
        if self.__sklearn_is_fitted__():
            return
        error: type[Exception] = NotFittedError
        if "sklearn" in sys.modules:
            from sklearn.exceptions import NotFittedError as SklearnError

            error = SklearnError
        name = type(self).__name__
        raise error(f"This {name} is not fitted yet: call fit or partial_fit first")

    def _check_inputs(self, X: ArrayLike, *, first: bool) -> Array:
        """Convert X to (n, d) float64; unless `first`, compare its columns with those fitted."""
        x = _as_float(X, "X")
        if x.ndim != 2:
            raise ValueError(
                f"X: Expected 2D array of shape (n, d), got shape {x.shape}. Reshape your data: "
                "X.reshape(-1, 1) has one column, X.reshape(1, -1) one row"
            )
        if x.shape[0] < 1:
            raise ValueError(f"X: 0 sample(s) (shape={x.shape}) while a minimum of 1 is required.")
        if x.shape[1] < 1:
            raise ValueError(f"X: 0 feature(s) (shape={x.shape}) while a minimum of 1 is required.")
        if not first:
            self._compare_names(_column_names(X))
            if x.shape[1] != self.n_features_in_:
                raise ValueError(
                    f"X has {x.shape[1]} features, but {type(self).__name__} is expecting "
                    f"{self.n_features_in_} features as input"
                )
        return x

    def _remember_columns(self, X: ArrayLike, n_features: int) -> None:
        """Keep the number and, of a data frame, the names of the columns of X."""
        self.n_features_in_ = n_features
        names = _column_names(X)
        if names is not None:
            self.feature_names_in_ = names
        elif hasattr(self, "feature_names_in_"):
            del self.feature_names_in_

    def _compare_names(self, names: Any) -> None:
        fitted: Any = getattr(self, "feature_names_in_", None)
        model = type(self).__name__
        if names is None and fitted is not None:
            warnings.warn(
                f"X does not have valid feature names, but {model} was fitted with feature names",
                UserWarning,
                stacklevel=4,
            )
        elif names is not None and fitted is None:
            warnings.warn(
                f"X has feature names, but {model} was fitted without feature names",
                UserWarning,
                stacklevel=4,
            )
        elif names is not None and list(names) != list(fitted):
            raise ValueError(_name_mismatch(list(names), list(fitted)))


def _defaults(model: type) -> dict[str, Any]:
    parameters = list(inspect.signature(model).parameters.values())
    return {parameter.name: parameter.default for parameter in parameters}


def _as_float(values: Any, name: str) -> Array:
    if hasattr(values, "tocsr"):
        raise TypeError(f"{name}: expected a dense array, got a sparse one; use its toarray()")
    array = np.asarray(values)
    if np.iscomplexobj(array):
        raise ValueError(f"{name}: Complex data not supported, got {array.dtype}")
    try:
        array = np.ascontiguousarray(array, dtype=np.float64) if array.ndim else array
    except (TypeError, ValueError) as problem:
        message = f"{name}: expected numbers, got {array.dtype} ({problem})"
        raise type(problem)(message) from None
    if array.ndim and not np.isfinite(array).all():
        raise ValueError(f"{name}: expected finite values, got NaN or infinity (inf)")
    return array


def check_outputs(y: Any, n_rows: int) -> Array:
    """Convert y to (n, m) float64."""
    if y is None:
        raise ValueError("y: requires y to be passed, but the target y is None")
    array = _as_float(y, "y")
    if array.ndim not in (1, 2):
        raise ValueError(f"y: expected shape (n,) or (n, m), got {array.shape}")
    if len(array) != n_rows:
        raise ValueError(f"y: expected {n_rows} rows as in X (consistent length), got {len(array)}")
    if array.ndim == 2 and array.shape[1] < 1:
        raise ValueError(f"y: expected at least one column, got shape {array.shape}")
    return array.reshape(n_rows, -1)


def _column_names(X: Any) -> Any:
    columns = getattr(X, "columns", None)
    if columns is None or not all(isinstance(name, str) for name in columns):
        return None
    return np.array(list(columns), dtype=object)


def _name_mismatch(names: list[str], fitted: list[str]) -> str:
    lines = ["The feature names should match those that were passed during fit."]
    unseen = sorted(set(names) - set(fitted))
    missing = sorted(set(fitted) - set(names))
    if unseen:
        lines += ["Feature names unseen at fit time:", *(f"- {name}" for name in unseen)]
    if missing:
        lines += ["Feature names seen at fit time, yet now missing:"]
        lines += [f"- {name}" for name in missing]
    if not unseen and not missing:
        lines.append("Feature names must be in the same order as they were in fit.")
    return "\n".join(lines) + "\n"
