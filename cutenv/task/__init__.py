"""The task: gentle cutting, its rewards, its ends and what an agent may see of it."""
