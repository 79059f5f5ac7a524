//! The order in which views are worked on.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use crate::Plan;

/// These views, each of which shares as many photographs, its own and those of its source views, with the one before as any that is
/// left; of equal ones the first. So most of the photographs and features that a view needs are in memory, whatever the names of the
/// photographs are, and whatever faces they are cut into. Views that are left out come first.
pub(crate) fn by_photographs(plan: &Plan, views: &BTreeSet<usize>) -> Vec<usize> {
    let is_planned = |view: &usize| plan.views[*view].is_ok();
    let mut left: BTreeSet<usize> = views.iter().copied().filter(is_planned).collect();
    let mut order: Vec<usize> = views.difference(&left).copied().collect();
    let mut users: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for &view in &left {
        photographs(plan, view).for_each(|photograph| users.entry(photograph).or_default().push(view));
    }
    let mut next = left.first().copied();
    while let Some(view) = next {
        left.remove(&view);
        order.push(view);
        let mut shared: BTreeMap<usize, usize> = BTreeMap::new();
        let beside = photographs(plan, view).flat_map(|photograph| &users[&photograph]);
        beside.filter(|user| left.contains(user)).for_each(|&user| *shared.entry(user).or_default() += 1);
        let best = shared.into_iter().max_by_key(|&(view, count)| (count, Reverse(view)));
        next = best.map(|(view, _)| view).or_else(|| left.first().copied());
    }
    order
}

/// The photographs that a view's depth map is made of.
fn photographs(plan: &Plan, view: usize) -> impl Iterator<Item = usize> {
    let sources = plan.views[view].iter().flat_map(|plan| plan.sources.iter().copied());
    std::iter::once(view).chain(sources)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ViewPlan;
    use vamvs_core::{DepthRange, Planes, Spacing};

    /// A plan with these source views of each view; `None`: it is left out.
    fn plan(sources: &[Option<&[usize]>]) -> Plan {
        let range = DepthRange { near: 1.0, far: 4.0 };
        let planes = Planes { range, count: 8, spacing: Spacing::InverseDepth };
        let view = |sources: &Option<&[usize]>| {
            let sources = sources.ok_or("no other view")?.to_vec();
            Ok(ViewPlan { sources, planes, origin: None, region: None, foveated: false })
        };
        Plan { cameras: Vec::new(), views: sources.iter().map(view).collect(), neighbours: Vec::new() }
    }

    fn order(sources: &[Option<&[usize]>]) -> Vec<usize> {
        by_photographs(&plan(sources), &(0..sources.len()).collect())
    }

    #[test]
    fn views_of_the_same_photographs_come_one_after_the_other() {
        // Two walks past the same places, whose photographs take turns, and a view that shares nothing with them.
        let turns = order(&[
            Some(&[2, 4]),
            Some(&[3, 5]),
            Some(&[0, 4]),
            Some(&[1, 5]),
            Some(&[2, 0]),
            Some(&[3, 1]),
            None,
        ]);
        assert_eq!(turns, [6, 0, 2, 4, 1, 3, 5]);
        assert_eq!(order(&[Some(&[1]), Some(&[0]), Some(&[3]), Some(&[2])]), [0, 1, 2, 3]);
    }

    #[test]
    fn photographs_in_the_order_in_which_they_were_taken_keep_it() {
        let video: Vec<Vec<usize>> =
            (0..9_usize).map(|at| (0..9).filter(|&to| at.abs_diff(to) == 1).collect()).collect();
        let video: Vec<Option<&[usize]>> = video.iter().map(|sources| Some(&sources[..])).collect();
        assert_eq!(order(&video)[..3], [0, 1, 2]);
    }

    #[test]
    fn some_of_the_views_are_ordered_alone() {
        let plan = plan(&[Some(&[3]), Some(&[2]), Some(&[1]), Some(&[0])]);
        assert_eq!(by_photographs(&plan, &BTreeSet::from([0, 1, 3])), [0, 3, 1]);
    }
}
