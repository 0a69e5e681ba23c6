"""What bumpstop claims of its speed, measured: ``make bench`` or ``python -m benchmarks`` from the repository root."""
