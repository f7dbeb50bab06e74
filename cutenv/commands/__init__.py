"""Sub-commands of ``cutenv`` that put several layers together: a module with ``main(argv)`` for each."""
