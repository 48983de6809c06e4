"""One page of a run that reads like the results section of a paper."""
