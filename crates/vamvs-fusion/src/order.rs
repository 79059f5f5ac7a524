//! The order in which views are visited.

use std::collections::{BTreeSet, VecDeque};

/// All views, such that views that are compared are close in the order (Cuthill–McKee): breadth
/// first over the neighbours, from a view at the edge. So most of the maps that a view needs are in
/// memory, whatever the order of the photographs. `neighbours` are mutual.
pub(crate) fn by_neighbourhood(neighbours: &[Vec<usize>]) -> Vec<usize> {
    let mut order = Vec::with_capacity(neighbours.len());
    let mut placed = vec![false; neighbours.len()];
    for view in 0..neighbours.len() {
        if !placed[view] {
            let at_the_edge = *breadth_first(neighbours, view).last().unwrap_or(&view);
            let connected = breadth_first(neighbours, at_the_edge);
            connected.iter().for_each(|&view| placed[view] = true);
            order.extend(connected);
        }
    }
    order
}

/// The views that are connected with `start`, nearest first.
fn breadth_first(neighbours: &[Vec<usize>], start: usize) -> Vec<usize> {
    let (mut seen, mut queue) = (BTreeSet::from([start]), VecDeque::from([start]));
    let mut order = Vec::new();
    while let Some(view) = queue.pop_front() {
        order.push(view);
        queue.extend(neighbours[view].iter().filter(|&&next| seen.insert(next)));
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Views in a row or, closed, on a ring, each with two neighbours to either side, numbered by `number`.
    fn row(count: usize, closed: bool, number: impl Fn(usize) -> usize) -> Vec<Vec<usize>> {
        let mut neighbours = vec![Vec::new(); count];
        for (at, step) in (0..count).flat_map(|at| [1, 2].map(|step| (at, step))) {
            if closed || at + step < count {
                let (a, b) = (number(at), number((at + step) % count));
                neighbours[a].push(b);
                neighbours[b].push(a);
            }
        }
        neighbours
    }

    /// The farthest that two neighbours are from each other in the order.
    fn bandwidth(neighbours: &[Vec<usize>]) -> usize {
        let order = by_neighbourhood(neighbours);
        let mut place = vec![usize::MAX; order.len()];
        order.iter().enumerate().for_each(|(at, &view)| place[view] = at);
        assert!(place.iter().all(|&at| at < neighbours.len()), "each view once");
        let apart = |view: usize| neighbours[view].iter().map(move |&other| (view, other));
        let apart = (0..order.len()).flat_map(apart).map(|(a, b)| place[a].abs_diff(place[b]));
        apart.max().unwrap_or(0)
    }

    #[test]
    fn shuffled_rows_and_rings_come_together_again() {
        let shuffled = |at: usize| at * 37 % 100;
        assert!(bandwidth(&row(100, false, shuffled)) <= 3);
        assert!(bandwidth(&row(100, true, shuffled)) <= 7);
    }

    #[test]
    fn islands_come_one_after_the_other() {
        assert_eq!(by_neighbourhood(&[vec![2], vec![3], vec![0], vec![1], vec![]]), [2, 0, 3, 1, 4]);
        assert!(by_neighbourhood(&[]).is_empty());
    }
}
