//! The smallest eigenvalues of a large symmetric matrix and their eigenvectors, by inverse iteration of a subspace with
//! Rayleigh-Ritz steps (Golub and Van Loan, Matrix Computations, 8.2): where they are few, a small part of the cost of all.

use nalgebra::{DMatrix, DVector};

/// Vectors that are iterated at first, and the least part of all (one in so many) that does not pay any more.
const FIRST_VECTORS: usize = 12;
const MOST_SHARE: usize = 4;
/// Steps after which a larger subspace is taken.
const STEPS: usize = 30;
/// Length of `A v - s v`, as a share of the bound, from which on a pair is found.
const RESIDUAL: f64 = 1e-7;

/// Some eigenvalues, and their eigenvectors as columns.
pub(super) struct Eigenpairs {
    pub(super) values: Vec<f64>,
    pub(super) vectors: DMatrix<f64>,
}

/// All eigenpairs of a symmetric matrix with an eigenvalue below the `bound`; none where they are too many to pay, or the
/// matrix is far from positive.
pub(super) fn below(matrix: &DMatrix<f64>, bound: f64) -> Option<Eigenpairs> {
    let n = matrix.nrows();
    let factor = (matrix + DMatrix::identity(n, n) * bound).cholesky()?;
    let mut count = FIRST_VECTORS;
    while count * MOST_SHARE <= n {
        // Any start does that is square to no eigenvector.
        let mut basis =
            DMatrix::from_fn(n, count, |r, c| ((r * count + c + 1) as f64 * 0.618_034).fract() - 0.5);
        for _ in 0..STEPS {
            basis = factor.solve(&basis).qr().q();
            let eigen = basis.tr_mul(&(matrix * &basis)).symmetric_eigen();
            basis *= &eigen.eigenvectors;
            let mut values = eigen.eigenvalues.iter().copied();
            // One beyond the bound is there when all below it are.
            if values.any(|value| value > 2.0 * bound)
                && let Some(found) = settled(matrix, &basis, &eigen.eigenvalues, bound)
            {
                return Some(found);
            }
        }
        count *= 2;
    }
    None
}

/// Those below the bound, if all up to twice the bound, or at least the smallest, are found.
fn settled(
    matrix: &DMatrix<f64>,
    basis: &DMatrix<f64>,
    values: &DVector<f64>,
    bound: f64,
) -> Option<Eigenpairs> {
    let near_to = 2.0 * bound.max(values.min());
    let is_found =
        |k: usize| (matrix * basis.column(k) - basis.column(k) * values[k]).norm() < RESIDUAL * near_to;
    let all: Vec<usize> = (0..values.len()).collect();
    if !all.iter().filter(|&&k| values[k] < near_to).all(|&k| is_found(k)) {
        return None;
    }
    let low: Vec<usize> = all.into_iter().filter(|&k| values[k] < bound).collect();
    let vectors = basis.select_columns(&low);
    Some(Eigenpairs { values: low.iter().map(|&k| values[k]).collect(), vectors })
}
