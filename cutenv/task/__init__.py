"""The task: gentle cutting, its rewards, its ends and its observation."""
