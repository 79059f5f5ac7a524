//! Which views are compared, and in which order they are visited.

use std::collections::BTreeSet;

use vamvs_core::Part;

use crate::FuseError;
use crate::order::by_neighbourhood;

/// The order of both passes. It follows from the neighbours alone, so processes with the same
/// neighbours agree on it.
#[derive(Clone, Debug)]
pub struct Schedule {
    /// For each view, the source views that it is checked against, in ascending order.
    pub(crate) sources: Vec<Vec<usize>>,
    /// For each view, its source views and the views that have it as source view: points are merged
    /// only between these.
    pub(crate) mutual: Vec<Vec<usize>>,
    /// The views in the order of the first pass, each near its neighbours.
    order: Vec<usize>,
}

impl Schedule {
    /// `neighbours` lists the source views of each of `len` views.
    ///
    /// # Errors
    /// If the number of lists differs from that of views, or a list names a view that does not
    /// exist.
    pub fn new(neighbours: &[Vec<usize>], len: usize) -> Result<Self, FuseError> {
        let sources = checked(neighbours, len)?;
        let mutual = mutual(&sources);
        let order = by_neighbourhood(&mutual);
        Ok(Self { sources, mutual, order })
    }

    /// The number of views.
    #[must_use]
    pub fn views(&self) -> usize {
        self.order.len()
    }

    /// The views of a part of the first pass, in their order.
    #[must_use]
    pub fn confirmed_in(&self, part: Part) -> &[usize] {
        &self.order[part.range(self.order.len())]
    }

    /// The views of a part of the second pass, in their order: the reverse of the first pass,
    /// because the files read last may still be cached.
    #[must_use]
    pub fn merged_in(&self, part: Part) -> Vec<usize> {
        let reversed: Vec<usize> = self.order.iter().rev().copied().collect();
        reversed[part.range(reversed.len())].to_vec()
    }

    /// The views whose consistent pixels the second pass needs for some views.
    #[must_use]
    pub fn needed_to_merge(&self, views: &[usize]) -> BTreeSet<usize> {
        views.iter().flat_map(|&view| self.mutual[view].iter().copied().chain([view])).collect()
    }
}

/// The neighbour lists in ascending order, each view once and none its own neighbour.
fn checked(lists: &[Vec<usize>], len: usize) -> Result<Vec<Vec<usize>>, FuseError> {
    if lists.len() != len {
        return Err(FuseError::NeighbourLists { expected: len, found: lists.len() });
    }
    let checked = |(view, list): (usize, &Vec<usize>)| {
        if let Some(&neighbour) = list.iter().find(|&&neighbour| neighbour >= len) {
            return Err(FuseError::Neighbour { view, neighbour, len });
        }
        Ok(ascending(list.iter().copied().filter(|&neighbour| neighbour != view).collect()))
    };
    lists.iter().enumerate().map(checked).collect()
}

fn mutual(sources: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut mutual = sources.to_vec();
    for (view, list) in sources.iter().enumerate() {
        list.iter().for_each(|&source| mutual[source].push(view));
    }
    mutual.into_iter().map(ascending).collect()
}

fn ascending(mut views: Vec<usize>) -> Vec<usize> {
    views.sort_unstable();
    views.dedup();
    views
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_become_mutual_and_sorted() {
        let schedule = Schedule::new(&[vec![2, 1, 2], vec![1], vec![]], 3).unwrap();
        assert_eq!(schedule.sources, [vec![1, 2], vec![], vec![]]);
        assert_eq!(schedule.mutual, [vec![1, 2], vec![0], vec![0]]);
        assert_eq!(schedule.needed_to_merge(&[1]), BTreeSet::from([0, 1]));
    }

    #[test]
    fn neighbours_that_are_none_are_named() {
        let error = Schedule::new(&[vec![1], vec![2]], 2).unwrap_err();
        assert_eq!(error.to_string(), "view 1 names 2 as a source view, but there are only views 0 to 1");
        assert!(Schedule::new(&[vec![]], 2).is_err());
    }

    #[test]
    fn parts_of_both_passes_hold_each_view_once() {
        let ring: Vec<Vec<usize>> = (0..10).map(|view| vec![(view + 1) % 10]).collect();
        let schedule = Schedule::new(&ring, 10).unwrap();
        let first: Vec<usize> =
            Part::all(3).flat_map(|part| schedule.confirmed_in(part).iter().copied()).collect();
        let second: Vec<usize> = Part::all(4).flat_map(|part| schedule.merged_in(part)).collect();
        assert!(first.iter().eq(second.iter().rev()));
        assert!(ascending(first).into_iter().eq(0..10));
    }
}
