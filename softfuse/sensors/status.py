"""What is to be said about a frame; a frame may have several."""

from enum import StrEnum


class Status(StrEnum):
    """All that `status` in estimates.csv may say, besides what each sensor says of itself, by its name."""

    ok = "ok"
    no_contact = "no contact"
    bad_time = "time missing or not believed"
    clock_anew = "clock taken anew"
    nothing_measured = "nothing measured"
    location_unknown = "location unknown"
    unseen = "not seen by electrodes"
    outside = "outside workspace"
    force_limit = "force limit"
    corrected = "full body used"
    lagging = "estimate lags"
    poor_fit = "poor fit"
    not_optimal = "optimum not reached"
    inverted = "inverted element"
    ambiguous = "several places possible"
