"""2006, figure 4 h: the toy train.

The paper renders solids made of kernels, semi-transparent, among them a toy train of 199,000. The train of
`ss.datasets` is built of primitives and filled with as many kernels as are asked for.
"""

import sheetsplat as ss

SIZE = (560, 420)

train = ss.datasets.toy_train(20_000)
print(train)
image = ss.render(train, size=SIZE)
print(f"{image.stats['kernels_drawn']:.0f} of {train.field().size} kernels are drawn")
image.save("paper_2006_train.png")
