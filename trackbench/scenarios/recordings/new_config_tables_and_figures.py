"""Tables and figures of a new config: of errors if there is a truth, and of predictions."""

from collections.abc import Iterator

from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.guess_truth import TruthGuess


def table_lines(guess: Guess, truth: TruthGuess | None) -> Iterator[str]:
    """Yield the lines of the tables: of errors if there is a truth, and of predictions.

    Without a truth the line of the key `hold_out` comes first.
    """
    if truth is None:
        # Every fifth measurement, and up to every second one of a very short run.
        _, rows_of_longest_run = guess.runs[0]
        every = max(2, min(5, rows_of_longest_run // 2))
        comment = "every n-th measurement is not given to the filters, and predicted instead"
        yield f"hold_out: {every}  # {comment}; without this key leave out the column Held out"
    yield "tables:"
    held = ""  # column of the measurements that the key `hold_out` keeps from the filters
    scores = "log score (higher is better); squared innovations (1 is right)"
    if truth is None:
        held = "Held out: mean(held_log_score), "
        scores = "log score (higher is better), of what is held out, too;"
        scores += " squared innovations (1 is right)"
    else:
        columns = "RMSE: rms(rmse_position), Largest: mean(peak_position)"
        title = "Errors of the position, m"
        if guess.inputs:  # of a robot
            columns = "Position: rms(rmse_position), Heading: rms(rmse_heading), ANEES: anees"
            title = "Errors, m and rad"
        elif truth.has_velocity:
            columns += ", ANEES: anees"
        else:
            columns += ", ANEES: anees_position"
        yield "  errors:"
        yield "    kind: metrics"
        yield f"    title: {title}"
        yield f"    columns: {{{columns}}}"
    yield "  prediction:"
    yield "    kind: metrics"
    yield f'    title: "Prediction: {scores}"'
    yield f"    columns: {{Log score: mean(log_score), {held}Innovations: mean(anis)}}"
    if guess.inputs:
        yield "  innovations: {kind: innovations}  # errors of predicted ranges and bearings"
