"""The same fits by numpy and scikit-learn, for `cargo bench --bench fit`.

usage: fit.py FOLDER POSES POINTS COEFFICIENTS PARAMETERS
Reads FOLDER/coefficients.f32 [pose, point, coefficient] and FOLDER/parameters.f32.
"""

import resource
import sys
import time

import numpy as np

folder = sys.argv[1]
p, v, c, a = map(int, sys.argv[2:6])


def peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000


def best(run, repeats=3):
    wall, cpu = [], []
    for _ in range(repeats):
        start = time.perf_counter(), time.process_time()
        run()
        wall.append(time.perf_counter() - start[0])
        cpu.append(time.process_time() - start[1])
    return f"{min(wall):6.2f} s, CPU {min(cpu):6.2f} s"


y = np.fromfile(f"{folder}/coefficients.f32", np.float32).reshape(p, v * c)
x = np.fromfile(f"{folder}/parameters.f32", np.float32).reshape(p, a)
print(f"peers: numpy {np.__version__}, {peak_mb()} MB resident after reading")


def ridge():
    """Leave-one-out over 20 alphas from K = B B', then the solution for the best."""
    centred = x.astype(np.float64) - x.mean(0, dtype=np.float64)
    u, s, vt = np.linalg.svd(centred, full_matrices=False)
    b = y - y.mean(0)
    k = (b @ b.T).astype(np.float64)
    errors = []
    alphas = s[0] * np.geomspace(1e-4, 10, 20)
    for alpha in alphas:
        d = s**2 / (s**2 + alpha**2)
        hat = (u * d) @ u.T
        kept = np.eye(p) - hat
        residual = np.einsum("ij,jk,ik->i", kept, k, kept, optimize=True)
        errors.append((residual / (1 - 1 / p - np.diag(hat)) ** 2).sum())
    alpha = alphas[int(np.argmin(errors))]
    gains = s / (s**2 + alpha**2)
    return ((vt.T * gains) @ u.T).astype(np.float32) @ b


seconds = best(ridge)
print(f"numpy   ridge, leave one out, f32     {seconds}, {peak_mb()} MB peak")

try:
    from sklearn.decomposition import PCA
except ImportError:
    sys.exit(0)

rows = np.ascontiguousarray(y.reshape(p, v, c).transpose(0, 2, 1)).reshape(p * c, v)
total = rows.var(0, dtype=np.float64).sum()
for dimensions, repeats in [(22, 3), (500, 1)]:
    pca = PCA(dimensions, svd_solver="randomized", random_state=0)
    seconds = best(lambda: pca.fit(rows), repeats)
    held = pca.explained_variance_.sum() * (p * c - 1) / (p * c) / total
    print(
        f"sklearn PCA({dimensions:3}), randomized         {seconds}, {peak_mb()} MB peak,"
        f" holds {held:.5f}"
    )
