"""What the engine is compared with. Each module makes one program run a scene: its class follows it, or just runs it.

A class takes the scene's parameters (names as in `dimersweep.simulate`) and one setting of its accuracy, and has

    follow(times)   states (n, 12) at ascending times, columns as in the reference runs, and the times of double impacts
    run(end)        the same run to one time with nothing kept: what is timed
    copies          how many runs of the scene `run` makes at once
"""
