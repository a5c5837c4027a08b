"""Signals that end a process, and the faults of compiled code that they report."""

import signal

_FAULTS_BY_SIGNAL = {
    "SIGSEGV": "a segmentation fault: an index beyond an array, or too deep a recursion",
    "SIGBUS": "a bus error: an address that is none, or a file that was cut",
    "SIGILL": "an illegal instruction: code that was compiled for another processor",
    "SIGFPE": "an arithmetic fault, such as a division of whole numbers by zero",
    "SIGABRT": "an abort: a failed assertion, an uncaught exception, or a damaged heap",
}
"""Faults of compiled code, by the signal that ends its process."""


def signal_name(number: int) -> str:
    """Return the name of a signal, such as SIGKILL, or its number if it has no name."""
    names = {known.value: known.name for known in signal.Signals}
    return names.get(number, str(number))


def fault_of_signal(number: int) -> str:
    """Describe the fault of compiled code that a signal reports; empty for other signals."""
    return _FAULTS_BY_SIGNAL.get(signal_name(number), "")
