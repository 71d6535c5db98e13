from drpbench.cli import main

main()
