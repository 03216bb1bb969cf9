"""What has nothing to do with trunks: files, threads, processes, versions."""
