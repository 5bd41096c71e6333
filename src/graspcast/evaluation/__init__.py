"""How good forecasts are: scores, protocols, comparisons with confidence intervals."""
