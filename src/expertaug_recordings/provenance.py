"""Where a frame rate is known from, in words that more than one stage knows."""

RENDERED = "rendered at this rate"  # by this project: nothing can be wrong with it
