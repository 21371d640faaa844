"""Running tiles: a work directory, tasks on an executor, readers, results."""
