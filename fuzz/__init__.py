"""Damaged and hostile files for every reader: mutations of a corpus, each read with bounded time and memory."""
