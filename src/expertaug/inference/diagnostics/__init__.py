"""Whether to trust it: calibration of posteriors, scores of predictive forecasts, alarms, and assumption A1."""
