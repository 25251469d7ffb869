"""One diagnosis for flights and thrust stands: hypotheses, evidence, search, verdict."""
