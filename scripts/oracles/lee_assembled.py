"""The same discrete equations as one sparse matrix: what the sweeps are held to, and slow."""

from collections import defaultdict
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from torchliner.checks import frequency_tensor
from torchliner.duct.case import DuctCase
from torchliner.duct.columns import Basis, Rows, element_matrices
from torchliner.duct.mesh import DuctMesh
from torchliner.duct.modes import DuctModes, duct_modes
from torchliner.duct.solver import wall_matrices
from torchliner.names import DIRECTIONS

Complex = NDArray[np.complex128]
Blocks = defaultdict[tuple[int, int], Complex]


def solve_assembled(case: DuctCase, frequency: float, impedance: Any, mesh: DuctMesh) -> tuple[Complex, float]:
    """One frequency and one impedance by sparse LU of all unknowns at once.

    Args:
        case: the duct; end reflections are single numbers, and the flow does not slip along a liner
            by Ingard's and Myers' condition.
        frequency: Hz.
        impedance: as for ``DuctSolver.solve``, of one item.
        mesh: of the duct.
    Returns:
        p, u and v at the elements' nodes, Pa (velocities times rho c), (columns, E, 3, n, n) with y
        before x; and the bytes of the factors.
    """
    matrix, right = assemble(case, frequency, impedance, mesh)
    factors = splu(matrix, permc_spec="COLAMD")
    n = mesh.degree + 1
    found = factors.solve(right).reshape(len(mesh.x) - 1, len(mesh.y) - 1, 3, n, n)
    return found, float(24 * (factors.L.nnz + factors.U.nnz))


def assemble(case: DuctCase, frequency: float, impedance: Any, mesh: DuctMesh) -> tuple[sparse.csc_matrix, Complex]:
    """Matrix and right-hand side; unknowns by column, element, field, y, x."""
    hertz = frequency_tensor(frequency)
    basis = Basis(mesh.degree)
    rows = Rows(basis, mesh.y, case.profile)
    flow = bool((rows.flow != 0).any())
    k = float(case.wavenumber(hertz))
    n, count = basis.count, len(mesh.y) - 1
    size = 3 * n * n
    y = mesh.y[:-1, None] + np.diff(mesh.y)[:, None] * basis.nodes.numpy()
    modes = [duct_modes(case.profile, hertz, count=1, direction=d) for d in DIRECTIONS]
    blocks: Blocks = defaultdict(lambda: np.zeros((size, size), np.complex128))
    along = n * (2 if flow else 1)
    ahead, back = slice(0, along), slice(along, along + n)
    up, down = slice(along + n, along + 2 * n), slice(along + 2 * n, along + 3 * n)
    wall = wall_matrices(impedance, mesh, basis, hertz).numpy()[0]
    ports = []
    for c, width in enumerate(mesh.widths.tolist()):
        steady, mass, *ports_of = element_matrices(width, basis, rows, flow)
        incoming, outgoing = (p.numpy() for p in ports_of)
        ports.append((incoming, outgoing))
        own = (steady + 1j * k * mass).numpy()
        for e in range(count):
            i = c * count + e
            blocks[i, i] += own[e]
            if e > 0:
                blocks[i, i - 1] -= incoming[e][:, up] @ outgoing[e - 1][up]
                blocks[i - 1, i] -= incoming[e - 1][:, down] @ outgoing[e][down]
            if c > 0:
                blocks[i, i - count] -= incoming[e][:, ahead] @ ports[c - 1][1][e][ahead]
                blocks[i - count, i] -= ports[c - 1][0][e][:, back] @ outgoing[e][back]
        top = count - 1
        blocks[i, i] -= incoming[top][:, down] @ outgoing[top][up]
        lined = int(mesh.lined[: c + 1].sum()) - 1
        returns = wall[lined] if mesh.lined[c] else np.eye(n)
        blocks[c * count, c * count] -= incoming[0][:, up] @ returns @ outgoing[0][down]
    right = _close_ends(blocks, case, mesh, basis, modes, y.ravel(), ports, along)
    return matrix_of(blocks, size), right


def _close_ends(
    blocks: Blocks,
    case: DuctCase,
    mesh: DuctMesh,
    basis: Basis,
    modes: list[DuctModes],
    y: NDArray[np.float64],
    ports: list[tuple[NDArray[np.float64], NDArray[np.float64]]],
    along: int,
) -> Complex:
    """Both ends' rank-one closures into the matrix; the right-hand side of the incident mode."""
    n, count = basis.count, len(mesh.y) - 1
    means = (np.diff(mesh.y)[:, None] * basis.weights.numpy() / case.height).ravel()
    right = np.zeros((len(ports), count, 3 * n * n), np.complex128)
    upstream = case.source == "upstream"
    returns = [complex(case.source_reflection), complex(case.end_reflection)]
    returns = returns if upstream else returns[::-1]
    alpha = float(modes[0 if upstream else 1].wavenumber[0, 0].real)
    p, u, v = (np.stack([one.numpy()[0, 0] for one in part]) for part in zip(*(m.at(y) for m in modes), strict=True))
    with_flow, against = np.concatenate([(p + u) / 2, v], -1)[:, : along * count], (p - u) / 2
    distance = case.place_of_incidence(case.source) - (case.start if upstream else case.end)
    sent = case.incident * np.exp(1j * alpha * distance)
    kinds = along // n
    for left in (True, False):
        c = 0 if left else len(ports) - 1
        ins, outs = (slice(0, along), slice(along, along + n)) if left else (slice(along, along + n), slice(0, n))
        into = with_flow if left else against
        reading = against if left else with_flow[:, : count * n]
        going, coming = (1, 0) if left else (0, 1)  # modes upstream and downstream
        r, mean = returns[0 if left else 1], reading @ means
        direction = (into[going] + r * into[coming]) / (mean[going] + r * mean[coming])
        drive = sent * (into[coming] - direction * mean[coming]) if left == upstream else 0 * direction
        incoming, outgoing = ports[c]
        shape = (kinds if left else 1, count, n)
        gain, drive = direction.reshape(shape), drive.reshape(shape)
        for e in range(count):
            column = incoming[e][:, ins] @ gain[:, e].ravel()
            right[c, e] += incoming[e][:, ins] @ drive[:, e].ravel()
            for other in range(count):
                row = means.reshape(count, n)[other] @ outgoing[other][outs]
                blocks[c * count + e, c * count + other] -= np.outer(column, row)
    return right.ravel()


def matrix_of(blocks: Mapping[tuple[int, int], Complex], size: int) -> sparse.csc_matrix:
    """Sparse, of dense blocks by their row and column of blocks."""
    rows, columns = size * np.array([*blocks]).T[:, :, None, None] + np.indices((size, size))[:, None]
    every = np.stack([*blocks.values()]).ravel()
    found = sparse.coo_matrix((every, (rows.ravel(), columns.ravel()))).tocsc()
    found.eliminate_zeros()
    return found
