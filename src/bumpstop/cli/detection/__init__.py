"""Commands about detection: tune, detect, detector, score and the undetectable forces."""
