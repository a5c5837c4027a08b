"""Messages on the deaths of worker processes: on a block that is given up, and the note after a run."""

from trackbench.component_parts import field_values
from trackbench.crash_signals import fault_of_signal, signal_name
from trackbench.errors import counted, counted_with_verb
from trackbench.evaluation.block_task import BlockTask

MOST_DEATHS = 4
"""How often a worker may die over one block before the block is given up."""


def death_message(task: BlockTask, exit_code: int | None) -> str:
    """Return the message on a block that is given up, because `MOST_DEATHS` workers died over it.

    ``exit_code`` is that of the last one: minus the number of a signal, or None if it is unknown. The
    system kills a process if memory is short.
    """
    block = f"over a block of {counted(task.width, 'run')}"
    times = f"{MOST_DEATHS} times"
    if exit_code is not None and exit_code > 0:
        return (
            f"its worker ended {times} with exit code {exit_code} {block}: the filter's code ends the "
            "process, in place of raising an exception"
        )
    if exit_code is not None and fault_of_signal(-exit_code):
        return (
            f"its worker was ended {times} by {signal_name(-exit_code)} {block}: "
            f"{fault_of_signal(-exit_code)}. This is a fault of the compiled code that the filter calls"
        )
    keys = "`block` or `N`" if "N" in field_values(task.filter) else "`block`"
    text = f"its worker died {times} (killed, or out of memory?) {block}"
    return f"{text}; a lower {keys} takes less memory"


def deaths_note(blocks: int) -> str:
    """Return the note after a run in which workers died: how many blocks were started again."""
    return f"note: a worker died; {counted_with_verb(blocks, 'block')} started again"
