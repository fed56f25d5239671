//! Nodes of a tree by number: all of them, or those of a part of the tree.

use std::ops::{Index, IndexMut};

/// Nodes by number. A part of a tree keeps the numbers of the whole.
pub struct Nodes<T> {
    nodes: Vec<T>,
    /// The number of each node, ascending; `None` if nodes are numbered from 0 without gaps.
    numbers: Option<Vec<u32>>,
}

impl<T> Default for Nodes<T> {
    fn default() -> Self {
        Self { nodes: Vec::new(), numbers: None }
    }
}

impl<T> Nodes<T> {
    /// A part, with the number of each node; `None` unless the numbers are ascending, one for each node.
    pub(crate) fn of_part(nodes: Vec<T>, numbers: Vec<u32>) -> Option<Self> {
        let ascending = numbers.is_sorted_by(|a, b| a < b) && numbers.len() == nodes.len();
        ascending.then_some(Self { nodes, numbers: Some(numbers) })
    }

    /// Add a node with the next number. Only for a whole tree.
    pub(crate) fn push(&mut self, node: T) {
        debug_assert!(self.numbers.is_none());
        self.nodes.push(node);
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// All nodes, in the order of their numbers.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &T> {
        self.nodes.iter()
    }

    /// All nodes with their numbers.
    pub fn numbered(&self) -> impl Iterator<Item = (u32, &T)> {
        let number = |i: usize| self.numbers.as_ref().map_or(i as u32, |numbers| numbers[i]);
        self.nodes.iter().enumerate().map(move |(i, node)| (number(i), node))
    }

    /// The node with this number, if it is in this part.
    pub fn get(&self, number: u32) -> Option<&T> {
        self.nodes.get(self.place(number as usize)?)
    }

    /// Where a node is; `None` if it is not in this part.
    fn place(&self, number: usize) -> Option<usize> {
        let Some(numbers) = &self.numbers else { return Some(number) };
        numbers.binary_search(&(number as u32)).ok()
    }

    /// Where a node is that must be in this part.
    fn known(&self, number: usize) -> usize {
        match self.place(number) {
            Some(place) => place,
            None => panic!("node {number} is not in this part of the tree"),
        }
    }
}

impl<T> Index<usize> for Nodes<T> {
    type Output = T;

    fn index(&self, number: usize) -> &T {
        &self.nodes[self.known(number)]
    }
}

impl<T> IndexMut<usize> for Nodes<T> {
    fn index_mut(&mut self, number: usize) -> &mut T {
        let place = self.known(number);
        &mut self.nodes[place]
    }
}
