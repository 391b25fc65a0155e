"""Programs recorded once and run over balls: values, gradients, Taylor coefficients, jets over arrays of boxes."""
