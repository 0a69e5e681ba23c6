"""Commands that plan measurements, read gauges and learn from them."""
