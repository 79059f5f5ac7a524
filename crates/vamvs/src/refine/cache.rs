//! A cache of photographs.

use std::collections::{HashMap, VecDeque};
use std::rc::Rc;

use vamvs_core::Photo;

use crate::VamvsError;

/// Memory for photographs, bytes.
const CAPACITY: usize = 512 << 20;

/// The photographs that were read last, as many as fit.
#[derive(Default)]
pub(crate) struct PhotoCache {
    photos: HashMap<usize, Rc<Photo>>,
    order: VecDeque<usize>,
    bytes: usize,
}

impl PhotoCache {
    /// A view's photograph, read if it is not kept.
    pub fn get(
        &mut self,
        view: usize,
        read: impl FnOnce() -> Result<Photo, VamvsError>,
    ) -> Result<Rc<Photo>, VamvsError> {
        if let Some(photo) = self.photos.get(&view) {
            return Ok(photo.clone());
        }
        let photo = Rc::new(read()?);
        self.bytes += bytes(&photo);
        self.photos.insert(view, photo.clone());
        self.order.push_back(view);
        while self.bytes > CAPACITY && self.order.len() > 1 {
            let oldest = self.order.pop_front().and_then(|view| self.photos.remove(&view));
            self.bytes -= oldest.as_deref().map_or(0, bytes);
        }
        Ok(photo)
    }
}

fn bytes(photo: &Photo) -> usize {
    photo.image.size().area() * (3 + usize::from(photo.mask.is_some()))
}
