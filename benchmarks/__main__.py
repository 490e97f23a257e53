"""All benchmarks, one after the other: `python -m benchmarks`, on an otherwise idle machine."""

from benchmarks import dataset, equilibria, renderer

for benchmark in (equilibria, renderer, dataset):
    for key, value in benchmark.run().items():
        print(f"{key}: {value}")
    print()
