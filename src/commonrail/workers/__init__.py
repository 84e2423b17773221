"""Work for other processes and machines: tasks in, answers out; what the work is, the caller alone knows."""
