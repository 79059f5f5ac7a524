//! The planes of all pixels, stored by the two colours of a checkerboard.

use rayon::prelude::*;
use vamvs_core::Size;

use crate::energy::{IMPOSSIBLE, Judged};
use crate::plane::Plane;
use crate::transfer::Views;

/// The variance of an inverse depth about which nothing is known, pixels of disparity squared.
pub(crate) const UNKNOWN: f32 = 1e4;

/// The state of a pixel.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct State {
    /// Its plane; w = 0 where there is none.
    pub plane: Plane,
    /// The plane's energy.
    pub energy: f32,
    /// The mean correlation of the source views that match it best.
    pub correlation: f32,
    /// The variance of its inverse depth, pixels of disparity squared.
    pub variance: f32,
    /// The source views that match it best; none if it was not matched itself.
    pub best: Views,
    /// Whether no Gauss–Newton step is due: the last one was negligible or did not lower the energy, or it was the only one.
    pub settled: bool,
    /// Whether neither the seed nor the photographs tell its depth, so that it is of no plane.
    pub unfounded: bool,
}

impl State {
    /// A plane whose energy has not been evaluated yet.
    pub fn unjudged(plane: Plane) -> Self {
        Self { plane, energy: IMPOSSIBLE, variance: UNKNOWN, ..Self::default() }
    }

    /// A plane with its energy, not settled yet.
    pub fn new(plane: Plane, judged: Judged) -> Self {
        let Judged { energy, correlation, best } = judged;
        Self { plane, energy, correlation, variance: UNKNOWN, best, ..Self::default() }
    }

    /// Whether the plane is the mean of its neighbours' and was not matched itself.
    pub fn is_between(&self) -> bool {
        self.best == 0 && self.energy < IMPOSSIBLE
    }

    /// The energy that another plane must fall below, with the views it was measured in.
    pub fn judged(&self) -> Judged {
        Judged { energy: self.energy, correlation: self.correlation, best: self.best }
    }
}

/// The states of all pixels. The two colours of a checkerboard are stored apart, so that threads can write one colour
/// while they read the other, and the result does not depend on the order.
pub(crate) struct Field {
    size: Size,
    stride: usize,
    colours: [Vec<State>; 2],
}

/// One colour of a field, read-only.
#[derive(Clone, Copy)]
pub(crate) struct Colour<'a> {
    size: Size,
    stride: usize,
    states: &'a [State],
}

/// A row of both colours.
pub(crate) struct Row<'a> {
    y: usize,
    colours: [&'a mut [State]; 2],
}

impl Row<'_> {
    #[inline]
    pub fn at_mut(&mut self, x: usize) -> &mut State {
        &mut self.colours[(x + self.y) % 2][x / 2]
    }
}

impl<'a> Colour<'a> {
    /// The state of the pixel at `(x, y) + offset`, which must be of this colour; `None` if it is outside of the
    /// image or has no plane.
    #[inline]
    pub fn neighbour(self, (x, y): (usize, usize), offset: (i32, i32)) -> Option<&'a State> {
        let (x, y) = (x.wrapping_add_signed(offset.0 as isize), y.wrapping_add_signed(offset.1 as isize));
        let inside = x < self.size.width && y < self.size.height;
        let state = inside.then(|| &self.states[y * self.stride + x / 2])?;
        (state.plane.w > 0.0).then_some(state)
    }
}

impl Field {
    /// A field without planes.
    pub fn empty(size: Size) -> Self {
        let stride = size.width.div_ceil(2);
        let states = || vec![State::default(); stride * size.height];
        Self { size, stride, colours: [states(), states()] }
    }

    /// A field whose pixels have the states `state(x, y)`.
    pub fn new(size: Size, state: impl Fn(usize, usize) -> State + Sync) -> Self {
        let mut field = Self::empty(size);
        for colour in 0..2 {
            field.update(colour, |_, x, y, own| *own = state(x, y));
        }
        field
    }

    pub fn size(&self) -> Size {
        self.size
    }

    #[inline]
    pub fn at(&self, x: usize, y: usize) -> &State {
        &self.colours[(x + y) % 2][y * self.stride + x / 2]
    }

    #[inline]
    pub fn at_mut(&mut self, x: usize, y: usize) -> &mut State {
        &mut self.colours[(x + y) % 2][y * self.stride + x / 2]
    }

    /// Changes the states row by row in parallel; `workspace` creates a thread's scratch memory.
    pub fn update_rows<W>(
        &mut self,
        workspace: impl Fn() -> W + Sync + Send,
        change: impl Fn(&mut W, usize, &mut Row) + Sync + Send,
    ) {
        let [first, second] =
            self.colours.each_mut().map(|states| states.par_chunks_exact_mut(self.stride.max(1)));
        first.zip(second).enumerate().for_each_init(workspace, |workspace, (y, (first, second))| {
            change(workspace, y, &mut Row { y, colours: [first, second] });
        });
    }

    /// Changes the states of one colour in parallel; `change` gets the other colour, the pixel's coordinates and its
    /// state.
    pub fn update(&mut self, colour: usize, change: impl Fn(Colour, usize, usize, &mut State) + Sync) {
        let (size, stride) = (self.size, self.stride);
        let [first, second] = &mut self.colours;
        let (own, other) = if colour == 0 { (first, second) } else { (second, first) };
        let other = Colour { size, stride, states: other };
        own.par_chunks_exact_mut(stride.max(1)).enumerate().for_each(|(y, row)| {
            let begin = (y + colour) % 2;
            for (place, state) in row.iter_mut().enumerate() {
                let x = 2 * place + begin;
                if x < size.width {
                    change(other, x, y, state);
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_of_the_other_colour_are_found_where_they_are() {
        let place = |x: usize, y: usize| (1 + 10 * y + x) as f32;
        let state = |x, y| State::unjudged(Plane { w: place(x, y), gx: 0.0, gy: 0.0 });
        let mut field = Field::new(Size::new(5, 4), state);
        assert_eq!(field.at(4, 3).plane.w, 35.0);
        for colour in 0..2 {
            field.update(colour, |other, x, y, own| {
                assert_eq!((x + y) % 2, colour);
                assert_eq!(own.plane.w, place(x, y));
                for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (1, -2), (-3, 0)] {
                    let (nx, ny) = (x as i32 + dx, y as i32 + dy);
                    let inside = (0..5).contains(&nx) && (0..4).contains(&ny);
                    let expected = inside.then(|| place(nx as usize, ny as usize));
                    assert_eq!(other.neighbour((x, y), (dx, dy)).map(|state| state.plane.w), expected);
                }
            });
        }
    }
}
