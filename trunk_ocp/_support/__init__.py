"""General support: files, threads, processes, versions; nothing about trunks."""
