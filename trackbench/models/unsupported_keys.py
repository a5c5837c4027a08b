"""Keys of motions and sensors that do not exist, such as `latency`, and what to write instead."""

_DELAY = (
    "the key is `delay`, of a sensor: {delay: 3} or {delay: {kind: uniform, most: 5}}, in steps"
)

_CONTROL = (
    "the key is `input`, of a motion `map` or `ode` ({input: [v, w]}) and of a recording ({input: {v: "
    "COLUMN}}); in a simulation write known inputs as expressions of k and t"
)

_CORRELATION = "not supported: process noise and measurement noise are independent"
UNSUPPORTED_KEYS = (
    dict.fromkeys(("delay", "delays", "latency"), _DELAY)
    | dict.fromkeys(("control", "controls", "inputs", "u", "B"), _CONTROL)
    | dict.fromkeys(("correlation", "correlated", "cross_covariance", "S"), _CORRELATION)
)
"""Keys of models that do not exist, with the reason."""
