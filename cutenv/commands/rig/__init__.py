"""Sub-commands of ``cutenv rig``: a module with ``main(argv)`` for each, loaded when it is asked for."""
