//! Matrix products on parts of slices, in the calling thread.

/// A matrix whose elements lie in a slice at regular distances.
#[derive(Clone, Copy)]
pub(super) struct Matrix<'a> {
    values: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Matrix<'a> {
    /// Rows of `columns` elements that begin `row_stride` apart.
    pub fn new(values: &'a [f32], rows: usize, columns: usize, row_stride: usize) -> Self {
        assert!(columns <= row_stride && extent(rows, columns, row_stride) <= values.len());
        Self { values, rows, columns, row_stride, column_stride: 1 }
    }

    /// `count` rows from number `from` on.
    pub fn rows(self, from: usize, count: usize) -> Self {
        assert!(from + count <= self.rows);
        Self { values: &self.values[from * self.row_stride..], rows: count, ..self }
    }

    pub fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }
}

/// What becomes of what the output held before.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Output {
    Overwrite,
    Add,
}

/// `scale · a b` into the rows of `output`, which begin `row_stride` apart.
pub(super) fn multiply(
    scale: f32,
    a: Matrix<'_>,
    b: Matrix<'_>,
    output: &mut [f32],
    row_stride: usize,
    mode: Output,
) {
    assert_eq!(a.columns, b.rows);
    assert!(b.columns <= row_stride && extent(a.rows, b.columns, row_stride) <= output.len());
    // SAFETY: `Matrix::new` and the assertions above checked that every element that the sizes and
    // strides reach lies in its slice, and `output` is borrowed exclusively. With `read_dst` false
    // gemm does not read the output.
    unsafe {
        gemm::gemm(
            a.rows,
            b.columns,
            a.columns,
            output.as_mut_ptr(),
            1,
            row_stride.cast_signed(),
            mode == Output::Add,
            a.values.as_ptr(),
            a.column_stride.cast_signed(),
            a.row_stride.cast_signed(),
            b.values.as_ptr(),
            b.column_stride.cast_signed(),
            b.row_stride.cast_signed(),
            1.0,
            scale,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

/// Length of the shortest slice that holds the matrix.
fn extent(rows: usize, columns: usize, row_stride: usize) -> usize {
    if rows == 0 || columns == 0 { 0 } else { (rows - 1) * row_stride + columns }
}
