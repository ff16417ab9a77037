//! The equations of a Newton step: a symmetric matrix with five diagonals, and two right sides.

/// Gradient and upper half of the matrix in (b, g, h) at one border; the gradient of the time and that of the barrier apart.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Local {
    pub(super) time: [f64; 3],
    pub(super) gradient: [f64; 3],
    /// bb, bg, bh, gg, gh, hh.
    pub(super) matrix: [f64; 6],
}

/// How (b, g, h) at a border follow from the three coefficients around it: b from the first two or the last two, which is 0 elsewhere.
#[derive(Clone, Copy, Debug)]
pub(super) struct Maps {
    pub(super) b: [f64; 3],
    pub(super) g: [f64; 3],
    pub(super) h: [f64; 3],
}

/// Five diagonals and two right sides, which the solution replaces.
#[derive(Debug, Default)]
pub(super) struct Matrix {
    pub(super) diagonal: Vec<f64>,
    pub(super) next: Vec<f64>,
    pub(super) after: Vec<f64>,
    /// Of the time, and of the barrier, in each row.
    pub(super) right: Vec<[f64; 2]>,
}

impl Matrix {
    /// Zero, with `n` rows.
    pub(super) fn clear(&mut self, n: usize) {
        for part in [&mut self.diagonal, &mut self.next, &mut self.after] {
            part.clear();
            part.resize(n, 0.0);
        }
        self.right.clear();
        self.right.resize(n, [0.0; 2]);
    }

    /// Adds terms in (b, g, h), which the three coefficients from `first` on make by `maps`.
    #[inline(always)]
    pub(super) fn add(&mut self, first: usize, local: &Local, maps: &Maps) {
        let [bb, bg, bh, gg, gh, hh] = local.matrix;
        let Maps { b, g, h } = maps;
        let row = |c: usize| {
            (
                bb * b[c] + bg * g[c] + bh * h[c],
                bg * b[c] + gg * g[c] + gh * h[c],
                bh * b[c] + gh * g[c] + hh * h[c],
            )
        };
        let entry = |r: usize, (x, y, z): (f64, f64, f64)| b[r] * x + g[r] * y + h[r] * z;
        let (zero, one, two) = (row(0), row(1), row(2));
        for c in 0..3 {
            let right = &mut self.right[first + c];
            right[0] += b[c] * local.time[0] + g[c] * local.time[1] + h[c] * local.time[2];
            right[1] += b[c] * local.gradient[0] + g[c] * local.gradient[1] + h[c] * local.gradient[2];
        }
        self.diagonal[first] += entry(0, zero);
        self.diagonal[first + 1] += entry(1, one);
        self.diagonal[first + 2] += entry(2, two);
        self.next[first] += entry(0, one);
        self.next[first + 1] += entry(1, two);
        self.after[first] += entry(0, two);
    }

    /// The same for terms in (b, g) of two coefficients.
    pub(super) fn add_two(&mut self, first: usize, local: &Local, b: [f64; 2], g: [f64; 2]) {
        let [bb, bg, _, gg, _, _] = local.matrix;
        let entry = |r: usize, c: usize| b[r] * (bb * b[c] + bg * g[c]) + g[r] * (bg * b[c] + gg * g[c]);
        for c in 0..2 {
            let right = &mut self.right[first + c];
            right[0] += b[c] * local.time[0] + g[c] * local.time[1];
            right[1] += b[c] * local.gradient[0] + g[c] * local.gradient[1];
            self.diagonal[first + c] += entry(c, c);
        }
        self.next[first] += entry(0, 1);
    }

    /// Coefficient 0 is `ratio` times coefficient 1.
    pub(super) fn tie_first(&mut self, ratio: f64) {
        for side in 0..2 {
            self.right[1][side] += ratio * self.right[0][side];
        }
        self.diagonal[1] += 2.0 * ratio * self.next[0] + ratio * ratio * self.diagonal[0];
        self.next[1] += ratio * self.after[0];
        self.fix(0);
    }

    /// The last coefficient is `ratio` times the one before it.
    pub(super) fn tie_last(&mut self, ratio: f64) {
        let n = self.diagonal.len();
        for side in 0..2 {
            self.right[n - 2][side] += ratio * self.right[n - 1][side];
        }
        self.diagonal[n - 2] += 2.0 * ratio * self.next[n - 2] + ratio * ratio * self.diagonal[n - 1];
        self.next[n - 3] += ratio * self.after[n - 3];
        self.fix(n - 1);
    }

    /// Row and column `i` leave the equations: its solution is 0.
    pub(super) fn fix(&mut self, i: usize) {
        self.diagonal[i] = 1.0;
        self.right[i] = [0.0; 2];
        self.next[i] = 0.0;
        self.after[i] = 0.0;
        if i > 0 {
            self.next[i - 1] = 0.0;
        }
        if i > 1 {
            self.after[i - 2] = 0.0;
        }
    }

    /// Solves by L D L^T; the solutions are in `right`.
    pub(super) fn solve(&mut self) {
        let n = self.diagonal.len();
        let (diagonal, next, after, right) = (
            &mut self.diagonal[..n],
            &mut self.next[..n],
            &mut self.after[..n],
            &mut self.right[..n],
        );
        for i in 0..n {
            let over = 1.0 / diagonal[i];
            let (a, b) = (next[i] * over, after[i] * over);
            let here = right[i];
            if i + 1 < n {
                diagonal[i + 1] -= a * next[i];
                next[i + 1] -= a * after[i];
                right[i + 1][0] -= a * here[0];
                right[i + 1][1] -= a * here[1];
            }
            if i + 2 < n {
                diagonal[i + 2] -= b * after[i];
                right[i + 2][0] -= b * here[0];
                right[i + 2][1] -= b * here[1];
            }
            next[i] = a;
            after[i] = b;
            right[i] = [here[0] * over, here[1] * over];
        }
        let (mut one, mut two) = ([0.0; 2], [0.0; 2]);
        for i in (0..n).rev() {
            let mut here = right[i];
            for side in 0..2 {
                here[side] -= next[i] * one[side] + after[i] * two[side];
            }
            right[i] = here;
            (one, two) = (here, one);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_solve_gives_is_the_solution_for_both_sides() {
        let n = 7;
        let mut matrix = Matrix::default();
        matrix.clear(n);
        for i in 0..n {
            matrix.diagonal[i] = 5.0 + i as f64;
            matrix.next[i] = if i + 1 < n { 1.0 - 0.3 * i as f64 } else { 0.0 };
            matrix.after[i] = if i + 2 < n { 0.7 } else { 0.0 };
            matrix.right[i] = [1.0 + i as f64, 2.0 - i as f64];
        }
        let (diagonal, next, after) = (matrix.diagonal.clone(), matrix.next.clone(), matrix.after.clone());
        let wanted = matrix.right.clone();
        matrix.solve();
        let x = &matrix.right;
        for side in 0..2 {
            for i in 0..n {
                let mut sum = diagonal[i] * x[i][side];
                if i + 1 < n {
                    sum += next[i] * x[i + 1][side];
                }
                if i + 2 < n {
                    sum += after[i] * x[i + 2][side];
                }
                if i > 0 {
                    sum += next[i - 1] * x[i - 1][side];
                }
                if i > 1 {
                    sum += after[i - 2] * x[i - 2][side];
                }
                assert!(
                    (sum - wanted[i][side]).abs() < 1e-12,
                    "row {i}: {sum} for {}",
                    wanted[i][side]
                );
            }
        }
    }
}
