//! Planar priors: pieces of the depth map that are planes, and each pixel drawn to its piece's plane as far as its own depth is uncertain.
use std::collections::BinaryHeap;
use std::cmp::Ordering;
use rayon::prelude::*;
use vamvs_core::Grid;
use crate::field::Field;
use crate::plane::Plane;
use crate::tune;

const BLOCK: usize = 8;

#[derive(Clone, Copy, Default, Debug)]
struct Sums { n: f64, p: f64, x: f64, y: f64, xx: f64, xy: f64, yy: f64, w: f64, xw: f64, yw: f64, ww: f64, step: f64 }

impl Sums {
    fn add(&mut self, x: f64, y: f64, w: f64, p: f64, step: f64) {
        self.n += 1.0; self.p += p; self.x += p * x; self.y += p * y; self.xx += p * x * x; self.xy += p * x * y; self.yy += p * y * y;
        self.w += p * w; self.xw += p * x * w; self.yw += p * y * w; self.ww += p * w * w; self.step += p * step;
    }
    fn plus(&self, o: &Self) -> Self {
        Self { n: self.n + o.n, p: self.p + o.p, x: self.x + o.x, y: self.y + o.y, xx: self.xx + o.xx, xy: self.xy + o.xy, yy: self.yy + o.yy,
            w: self.w + o.w, xw: self.xw + o.xw, yw: self.yw + o.yw, ww: self.ww + o.ww, step: self.step + o.step }
    }
    /// centred: mean, covariance, slopes
    fn fit(&self) -> Fit {
        let (mx, my, mw) = (self.x / self.p, self.y / self.p, self.w / self.p);
        let cxx = self.xx / self.p - mx * mx + 1.0; let cyy = self.yy / self.p - my * my + 1.0; let cxy = self.xy / self.p - mx * my;
        let cxw = self.xw / self.p - mx * mw; let cyw = self.yw / self.p - my * mw;
        let det = cxx * cyy - cxy * cxy;
        let (gx, gy) = ((cyy * cxw - cxy * cyw) / det, (cxx * cyw - cxy * cxw) / det);
        Fit { mx, my, mw, gx, gy, cxx, cxy, cyy, det }
    }
    /// mean square residual of a plane
    fn residual(&self, f: &Fit) -> f64 {
        // w - (f.mw + gx (x - f.mx) + gy (y - f.my))
        let c = f.mw - f.gx * f.mx - f.gy * f.my;
        let (gx, gy) = (f.gx, f.gy);
        let s = self.ww + gx * gx * self.xx + gy * gy * self.yy + c * c * self.p - 2.0 * gx * self.xw - 2.0 * gy * self.yw - 2.0 * c * self.w
            + 2.0 * gx * gy * self.xy + 2.0 * gx * c * self.x + 2.0 * gy * c * self.y;
        s.max(0.0)
    }
}
#[derive(Clone, Copy, Debug)]
struct Fit { mx: f64, my: f64, mw: f64, gx: f64, gy: f64, cxx: f64, cxy: f64, cyy: f64, det: f64 }
impl Fit {
    fn at(&self, x: f64, y: f64) -> f64 { self.mw + self.gx * (x - self.mx) + self.gy * (y - self.my) }
    fn spread(&self, x: f64, y: f64) -> f64 {
        let (dx, dy) = (x - self.mx, y - self.my);
        1.0 + (self.cyy * dx * dx - 2.0 * self.cxy * dx * dy + self.cxx * dy * dy) / self.det
    }
}

struct Edge { cost: f64, a: usize, b: usize, va: u32, vb: u32 }
impl PartialEq for Edge { fn eq(&self, o: &Self) -> bool { self.cmp(o) == Ordering::Equal } }
impl Eq for Edge {}
impl PartialOrd for Edge { fn partial_cmp(&self, o: &Self) -> Option<Ordering> { Some(self.cmp(o)) } }
impl Ord for Edge { fn cmp(&self, o: &Self) -> Ordering { o.cost.total_cmp(&self.cost).then(o.a.cmp(&self.a)).then(o.b.cmp(&self.b)) } }

struct Node { sums: Sums, fit: Fit, sse: f64, version: u32, near: Vec<usize>, parent: usize }

fn cost(a: &Node, b: &Node) -> f64 {
    let nc = tune(4) as f64; let k = tune(5) as f64; let tol = tune(6) as f64;
    let both = a.sums.plus(&b.sums);
    let fit = both.fit();
    let ratio = |n: &Node| {
        let step = n.sums.step / n.sums.p;
        let d = n.sums.residual(&fit) - n.sse;
        d / (nc * k + n.sums.p * (tol * step).powi(2))
    };
    ratio(a).max(ratio(b))
}

pub(crate) fn planar(field: &mut Field, steps: &Grid<f32>) {
    let size = field.size();
    let (bw, bh) = (size.width.div_ceil(BLOCK), size.height.div_ceil(BLOCK));
    let factor = tune(7);
    let sigma2 = |x: usize, y: usize, v: f32| -> f64 {
        let step = steps[(x, y)];
        ((factor * factor * v + 0.0025) * step * step) as f64
    };
    let sums: Vec<Option<Sums>> = (0..bw * bh).into_par_iter().map(|at| {
        let (bx, by) = (at % bw, at / bw);
        let mut s = Sums::default();
        for y in by * BLOCK..((by + 1) * BLOCK).min(size.height) { for x in bx * BLOCK..((bx + 1) * BLOCK).min(size.width) {
            let st = field.at(x, y);
            if st.plane.w > 0.0 { s.add(x as f64, y as f64, st.plane.w as f64, 1.0 / sigma2(x, y, st.variance), steps[(x, y)] as f64); }
        } }
        if s.n < 32.0 { return None }
        let f = s.fit();
        let ms = s.residual(&f) / s.p;
        let step = s.step / s.p;
        (ms < (tune(8) as f64 * step).powi(2) + 4.0 * s.n / s.p).then_some(s)
    }).collect();
    let mut nodes: Vec<Option<Node>> = sums.iter().enumerate().map(|(at, s)| s.map(|sums| {
        let fit = sums.fit();
        let (bx, by) = (at % bw, at / bw);
        let mut near = Vec::new();
        if bx > 0 { near.push(at - 1) } if bx + 1 < bw { near.push(at + 1) } if by > 0 { near.push(at - bw) } if by + 1 < bh { near.push(at + bw) }
        near.retain(|&n| sums_is(&sums_ref(&sums), n) );
        Node { sse: sums.residual(&fit), sums, fit, version: 0, near, parent: at }
    })).collect();
    fn sums_ref(_: &Sums) -> () {}
    fn sums_is(_: &(), _: usize) -> bool { true }
    for at in 0..nodes.len() { if let Some(mut n) = nodes[at].take() { n.near.retain(|&o| sums[o].is_some()); nodes[at] = Some(n); } }
    let mut heap = BinaryHeap::new();
    let push = |heap: &mut BinaryHeap<Edge>, nodes: &[Option<Node>], a: usize, b: usize| {
        let (na, nb) = (nodes[a].as_ref().unwrap(), nodes[b].as_ref().unwrap());
        let c = cost(na, nb);
        if c < 1.0 { heap.push(Edge { cost: c, a, b, va: na.version, vb: nb.version }); }
    };
    for a in 0..nodes.len() { if nodes[a].is_some() { for b in nodes[a].as_ref().unwrap().near.clone() { if a < b { push(&mut heap, &nodes, a, b); } } } }
    let mut root: Vec<usize> = (0..nodes.len()).collect();
    while let Some(e) = heap.pop() {
        let ok = |i: usize, v: u32| root[i] == i && nodes[i].as_ref().is_some_and(|n| n.version == v);
        if !(ok(e.a, e.va) && ok(e.b, e.vb)) { continue }
        let nb = nodes[e.b].take().unwrap();
        let mut na = nodes[e.a].take().unwrap();
        root[e.b] = e.a;
        na.sums = na.sums.plus(&nb.sums); na.fit = na.sums.fit(); na.sse = na.sums.residual(&na.fit); na.version += 1;
        na.near.extend(nb.near);
        let find = |root: &mut Vec<usize>, mut i: usize| { while root[i] != i { root[i] = root[root[i]]; i = root[i]; } i };
        for n in &mut na.near { *n = find(&mut root, *n); }
        na.near.sort_unstable(); na.near.dedup(); na.near.retain(|&n| n != e.a);
        let near = na.near.clone();
        nodes[e.a] = Some(na);
        for b in near { push(&mut heap, &nodes, e.a, b); }
    }
    let find = |mut i: usize| { while root[i] != i { i = root[i]; } i };
    let of_block: Vec<usize> = (0..nodes.len()).map(find).collect();
    let nc = tune(4) as f64;
    if tune(9) > 0.0 {
        let mut count = 0; let mut big = 0;
        for n in nodes.iter().flatten() { count += 1; if n.sums.n > 5000.0 { big += n.sums.n as usize; } }
        eprintln!("segments {count}, pixels in big {:.3}", big as f64 / size.area() as f64);
    }
    let relief: Vec<f64> = nodes.iter().map(|n| n.as_ref().map_or(0.0, |n| {
        let step = n.sums.step / n.sums.p;
        (n.sse / n.sums.p - n.sums.n / n.sums.p).max(0.0) + (tune(10) as f64 * step).powi(2)
    })).collect();
    let gate = tune(11) as f64;
    for colour in 0..2 {
        field.update(colour, |_, x, y, state| {
            if state.plane.w <= 0.0 { return }
            let (bx, by) = (x / BLOCK, y / BLOCK);
            let own = sigma2(x, y, state.variance);
            let (fx, fy) = (x as f64, y as f64);
            let mut best: Option<(f64, usize)> = None;
            for cy in by.saturating_sub(1)..(by + 2).min(bh) { for cx in bx.saturating_sub(1)..(bx + 2).min(bw) {
                let r = of_block[cy * bw + cx];
                let Some(n) = &nodes[r] else { continue };
                let d = (n.fit.at(fx, fy) - state.plane.w as f64).abs();
                if best.is_none_or(|b| d < b.0) { best = Some((d, r)); }
            } }
            let Some((d, r)) = best else { return };
            let n = nodes[r].as_ref().unwrap();
            let prior = relief[r] + nc / n.sums.p * n.fit.spread(fx, fy);
            if d * d > gate * gate * (own + prior) { return }
            let t = own / (own + prior);
            let w = state.plane.w as f64 + t * (n.fit.at(fx, fy) - state.plane.w as f64);
            let mix = |a: f32, b: f64| (a as f64 + t * (b - a as f64)) as f32;
            state.plane = Plane { w: w as f32, gx: mix(state.plane.gx, n.fit.gx), gy: mix(state.plane.gy, n.fit.gy) };
            let step = steps[(x, y)] as f64;
            state.variance = (((1.0 / (1.0 / own + 1.0 / prior)) / (step * step)) as f32 / (factor * factor)).min(state.variance);
        });
    }
}
