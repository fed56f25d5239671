//! Connectivity: a cut-border machine that grows over all patches of a chunk at once. FORMAT section 5.4. (Gumhold and
//! Straßer, "Real time compression of triangle mesh connectivity", 1998; contexts by the triangles that a vertex has so
//! far, after Touma and Gotsman, "Triangle mesh compression", 1998.)
//!
//! *Gates* are the directed edges of the triangles so far across which no triangle is known yet; they form loops. The
//! machine takes one gate after another, fan by fan, and codes what lies across it. It never assumes a manifold: what
//! cannot be reached across an edge starts over. Encoder and decoder run the same code; only [`Source`] differs.

/// No such gate, vertex or patch.
pub(super) const NONE: u32 = u32::MAX;
/// Triangles at a vertex that make a difference.
pub(super) const MAX_AT_VERTEX: u8 = 9;
/// How far along the border a vertex is looked for before it is named by its number.
pub(super) const REACH: u32 = 24;

/// The next operation across a gate.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Op {
    /// A triangle with a new vertex.
    New,
    /// Nothing that is not known yet.
    Border,
    /// A triangle that closes the angle to the gate before.
    Left,
    /// A triangle that closes the angle to the gate behind.
    Right,
    /// A triangle to a vertex that many steps along the border: even forward, odd backward.
    Along(u32),
    /// A triangle to any known vertex.
    Known(u32),
}

/// An edge of the border.
#[derive(Clone, Copy)]
struct Gate {
    from: u32,
    next: u32,
    before: u32,
    /// The third vertex of the gate's triangle.
    apex: u32,
    /// Three times the gate's triangle plus the corner where the edge begins.
    edge: u32,
    state: State,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    /// Nobody has asked yet what lies across.
    Open,
    /// Nothing does.
    Dead,
    /// A triangle does; the gate is in no loop any more.
    Glued,
}

/// A triangle in the order of the machine.
#[derive(Clone, Copy, Default)]
pub(super) struct Placed {
    pub(super) corners: [u32; 3],
    pub(super) patch: u32,
}

/// What a vertex is predicted from: one parallelogram or two, each of two triangles on both sides of an edge. Where there
/// is one, it fills the places of the second as well, and the vertex that a lone one lies near fills all places, so that one
/// formula serves all.
#[derive(Clone, Copy)]
pub(super) struct Link {
    /// The edge of the triangle that introduced the vertex; [`NONE`] where no other vertex is known.
    pub(super) edge: [u32; 2],
    /// The vertex across that edge.
    pub(super) across: u32,
    /// The edge of another triangle of the vertex.
    pub(super) edge2: [u32; 2],
    /// The vertex across that.
    pub(super) across2: u32,
    /// The vertex that both edges have, else any.
    pub(super) shared: u32,
    pub(super) kind: Kind,
}

/// How many parallelograms a [`Link`] has.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// None: there is a vertex nearby, or none at all.
    Near,
    /// One.
    One,
    /// Two whose edges have no vertex in common.
    Two,
    /// Two whose edges meet.
    Fan,
}

impl Link {
    /// Near a vertex, or near [`NONE`].
    #[inline]
    pub(super) fn near(v: u32) -> Self {
        Self { edge: [v; 2], across: v, edge2: [v; 2], across2: v, shared: v, kind: Kind::Near }
    }

    #[inline]
    fn one(edge: [u32; 2], across: u32) -> Self {
        let [shared, _] = edge;
        Self { edge, across, edge2: edge, across2: across, shared, kind: Kind::One }
    }

    /// Two parallelograms?
    #[inline]
    pub(super) fn is_two(&self) -> bool {
        matches!(self.kind, Kind::Two | Kind::Fan)
    }

    /// One more parallelogram; two stay.
    #[inline]
    fn add(&mut self, edge: [u32; 2], across: u32) {
        match self.kind {
            Kind::Near => *self = Self::one(edge, across),
            Kind::One => {
                let ([a, b], [c, d]) = (self.edge, edge);
                let (first, second) = (a == c || a == d, b == c || b == d);
                self.edge2 = edge;
                self.across2 = across;
                self.shared = if first || !second { a } else { b };
                self.kind = if first || second { Kind::Fan } else { Kind::Two };
            }
            Kind::Two | Kind::Fan => {}
        }
    }
}

/// What the encoder knows. All vertices are the machine's numbers.
pub(super) trait Source {
    /// The third vertex, and the patch, of an unused triangle with the directed edge `to`–`from`; the triangle is used
    /// up, and a new vertex numbered.
    fn across(&mut self, from: u32, to: u32) -> Option<(u32, u32)>;
    /// The vertices and the patch of the next unused triangle, which is used up; new vertices are numbered.
    fn seed(&mut self) -> Option<([u32; 3], u32)>;
}

/// The decoder's [`Source`]: there is none.
pub(super) struct Unknown;

impl Source for Unknown {
    fn across(&mut self, _: u32, _: u32) -> Option<(u32, u32)> {
        None
    }

    fn seed(&mut self) -> Option<([u32; 3], u32)> {
        None
    }
}

/// What the machine made.
pub(super) struct Connectivity {
    /// In the order of the machine.
    pub(super) triangles: Vec<Placed>,
    /// One for every vertex that a triangle uses.
    pub(super) links: Vec<Link>,
    /// Edges across which no triangle was found: three times the triangle plus the corner where the edge begins.
    pub(super) open: Vec<u32>,
}

/// Patches around a vertex.
#[derive(Clone, Copy)]
struct Around {
    /// Triangles so far, at most [`MAX_AT_VERTEX`].
    triangles: u8,
    /// Patch of the latest triangle.
    latest: u32,
    /// Another patch, the latest, or [`NONE`].
    other: u32,
    /// The latest gate that begins here.
    gate: u32,
}

/// What an operation depends on.
#[derive(Clone, Copy)]
pub(super) struct Near {
    /// Triangles so far at both ends of the gate, at most [`MAX_AT_VERTEX`].
    pub(super) triangles: [u8; 2],
    /// Whether the gate before it, and the one behind, can be closed with it.
    pub(super) left: bool,
    /// See `left`.
    pub(super) right: bool,
}

/// How the machine's choices are coded. On the decoder's side the value that is passed in is ignored and the one that was
/// coded comes out.
pub(super) trait Choices {
    /// An operation; [`Op::Known`] counts back from `last`, the latest vertex.
    fn op(&mut self, about: Near, last: u32, op: Op) -> Result<Op, Impossible>;
    /// A vertex by its number, counted back from the latest.
    fn known(&mut self, last: u32, v: u32) -> Result<u32, Impossible>;
    /// Whether the k-th corner of a seed is new.
    fn fresh(&mut self, k: usize, new: bool) -> bool;
    /// Whether a triangle is of its neighbour's patch; 16 contexts.
    fn same_patch(&mut self, context: usize, same: bool) -> bool;
    /// Whether a patch is the likeliest other one.
    fn guess(&mut self, right: bool) -> bool;
    /// Up to 16 bits without a model.
    fn raw(&mut self, bits: u32, value: u32) -> u32;
}

/// The machine. `limit` holds what the counts of the chunk allow.
pub(super) struct Machine<'a, C, S> {
    coder: C,
    source: &'a mut S,
    limits: Limits,
    gates: Vec<Gate>,
    /// Gates that were opened, the latest last; some are glued by now.
    waiting: Vec<u32>,
    around: Vec<Around>,
    made: Connectivity,
}

/// Sizes of the chunk.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    pub(super) vertices: u32,
    pub(super) triangles: u32,
    pub(super) patches: u32,
}

/// Something that no encoder writes.
#[derive(Debug)]
pub(super) struct Impossible;

/// A length; all are below 2^32, because a chunk's counts are.
fn count<T>(items: &[T]) -> u32 {
    u32::try_from(items.len()).unwrap_or(NONE)
}

impl<'a, C: Choices, S: Source> Machine<'a, C, S> {
    pub(super) fn new(coder: C, source: &'a mut S, limits: Limits) -> Self {
        let Limits { vertices, triangles, .. } = limits;
        let made = Connectivity {
            triangles: Vec::with_capacity(triangles as usize),
            links: Vec::with_capacity(vertices as usize),
            open: Vec::new(),
        };
        let gates = Vec::with_capacity(2 * triangles as usize);
        Self { coder, source, limits, gates, waiting: Vec::new(), around: Vec::with_capacity(vertices as usize), made }
    }

    /// Code all triangles. Gives the coder back.
    pub(super) fn run(mut self) -> Result<(Connectivity, C), Impossible> {
        while self.missing() {
            let Some(mut gate) = self.waiting.pop() else {
                self.seed()?;
                continue;
            };
            while self.missing() && self.gate(gate).state == State::Open {
                let Some(turned) = self.step(gate)? else { break };
                gate = turned;
            }
        }
        self.made.open = self.gates.iter().filter(|g| g.state != State::Glued).map(|g| g.edge).collect();
        Ok((self.made, self.coder))
    }

    fn missing(&self) -> bool {
        self.made.triangles.len() < self.limits.triangles as usize
    }

    /// Gates and vertices are named by numbers that the machine gave out itself.
    #[inline]
    fn gate(&self, g: u32) -> Gate {
        const GLUED: Gate = Gate { from: 0, next: 0, before: 0, apex: 0, edge: 0, state: State::Glued };
        self.gates.get(g as usize).copied().unwrap_or(GLUED)
    }

    #[inline]
    fn around(&self, v: u32) -> Around {
        const NEW: Around = Around { triangles: 0, latest: NONE, other: NONE, gate: NONE };
        self.around.get(v as usize).copied().unwrap_or(NEW)
    }

    fn set_state(&mut self, g: u32, state: State) {
        if let Some(gate) = self.gates.get_mut(g as usize) {
            gate.state = state;
        }
    }

    /// Make `b` follow `a` in their loop.
    fn join(&mut self, a: u32, b: u32) {
        if let Some(gate) = self.gates.get_mut(a as usize) {
            gate.next = b;
        }
        if let Some(gate) = self.gates.get_mut(b as usize) {
            gate.before = a;
        }
    }

    /// A new gate; its neighbours are set by [`Self::join`].
    fn open(&mut self, from: u32, apex: u32, edge: u32) -> u32 {
        let number = count(&self.gates);
        self.gates.push(Gate { from, next: number, before: number, apex, edge, state: State::Open });
        self.waiting.push(number);
        if let Some(around) = self.around.get_mut(from as usize) {
            around.gate = number;
        }
        number
    }

    /// Code what lies across a gate. Returns the gate that continues round the same vertex.
    fn step(&mut self, g: u32) -> Result<Option<u32>, Impossible> {
        let gate = self.gate(g);
        let (a, b) = (gate.from, self.gate(gate.next).from);
        let found = self.source.across(a, b);
        let wanted = found.map_or(Op::Border, |(c, _)| self.op_of(g, c));
        let op = self.code_op(g, a, b, wanted)?;
        let c = match op {
            Op::Border => {
                self.set_state(g, State::Dead);
                return Ok(None);
            }
            Op::New => self.new_vertex(Link::one([a, b], gate.apex))?,
            Op::Left => self.gate(gate.before).from,
            Op::Right => self.gate(self.gate(gate.next).next).from,
            Op::Along(steps) => self.gate(self.walk(g, steps)).from,
            Op::Known(v) => v,
        };
        let patch = self.code_patch(self.patch_of(gate.edge), [a, b, c], op == Op::New, found.map_or(0, |f| f.1))?;
        let triangle = self.place([b, a, c], patch);
        if op != Op::New {
            self.pair([a, b], gate.apex, c);
        }
        Ok(self.attach(g, op, c, triangle))
    }

    /// Put the triangle's two other edges into the loops. Returns the one that begins where the gate did.
    fn attach(&mut self, g: u32, op: Op, c: u32, triangle: u32) -> Option<u32> {
        match op {
            Op::Border => None,
            Op::Left => {
                self.attach_left(g, c, triangle);
                None
            }
            Op::Right => self.attach_right(g, c, triangle),
            Op::New => Some(self.attach_between(g, c, triangle, NONE)),
            Op::Along(steps) => Some(self.attach_between(g, c, triangle, self.walk(g, steps))),
            Op::Known(v) => Some(self.attach_between(g, c, triangle, self.begins_at(v))),
        }
    }

    fn attach_left(&mut self, g: u32, c: u32, triangle: u32) {
        let gate = self.gate(g);
        let left = self.gate(gate.before);
        self.set_state(g, State::Glued);
        self.set_state(gate.before, State::Glued);
        self.pair([c, gate.from], left.apex, self.gate(gate.next).from);
        let new = self.open(c, gate.from, 3 * triangle + 2);
        self.join(left.before, new);
        self.join(new, gate.next);
    }

    fn attach_right(&mut self, g: u32, c: u32, triangle: u32) -> Option<u32> {
        let gate = self.gate(g);
        let (right, left) = (self.gate(gate.next), self.gate(gate.before));
        self.set_state(g, State::Glued);
        self.set_state(gate.next, State::Glued);
        self.pair([right.from, c], right.apex, gate.from);
        if right.next == gate.before && left.state == State::Open {
            // A hole of three edges is full.
            self.set_state(gate.before, State::Glued);
            self.pair([c, gate.from], left.apex, right.from);
            return None;
        }
        let new = self.open(gate.from, right.from, 3 * triangle + 1);
        self.join(gate.before, new);
        self.join(new, right.next);
        Some(new)
    }

    /// Two new edges; `there` begins at their common vertex.
    fn attach_between(&mut self, g: u32, c: u32, triangle: u32, there: u32) -> u32 {
        let gate = self.gate(g);
        let b = self.gate(gate.next).from;
        self.set_state(g, State::Glued);
        let first = self.open(gate.from, b, 3 * triangle + 1);
        let second = self.open(c, gate.from, 3 * triangle + 2);
        let incoming = self.gate(there).before;
        self.join(gate.before, first);
        self.join(second, gate.next);
        if there == NONE || there == g {
            self.join(first, second);
        } else {
            // The loop divides at c, or two loops become one.
            self.join(incoming, second);
            self.join(first, there);
        }
        first
    }

    /// The latest gate that begins at a vertex, where that is still in a loop.
    fn begins_at(&self, v: u32) -> u32 {
        let gate = self.around(v).gate;
        if self.gate(gate).state == State::Glued { NONE } else { gate }
    }

    /// The gate that many steps along the border.
    #[cold]
    #[inline(never)]
    fn walk(&self, g: u32, steps: u32) -> u32 {
        let forward = steps.is_multiple_of(2);
        let mut at = if forward { self.gate(g).next } else { g };
        for _ in 0..=steps / 2 {
            at = if forward { self.gate(at).next } else { self.gate(at).before };
        }
        at
    }

    /// How the encoder says that c is the third vertex.
    #[cold]
    #[inline(never)]
    fn op_of(&self, g: u32, c: u32) -> Op {
        if c as usize >= self.around.len() {
            return Op::New;
        }
        let gate = self.gate(g);
        let behind = self.gate(gate.next);
        if self.can_close_right(g) && self.gate(behind.next).from == c {
            return Op::Right;
        }
        if self.can_close_left(g) && self.gate(gate.before).from == c {
            return Op::Left;
        }
        let (mut forward, mut backward) = (gate.next, g);
        for k in 0..REACH {
            (forward, backward) = (self.gate(forward).next, self.gate(backward).before);
            if self.gate(forward).from == c {
                return Op::Along(2 * k);
            }
            if self.gate(backward).from == c {
                return Op::Along(2 * k + 1);
            }
        }
        Op::Known(c)
    }

    fn can_close_left(&self, g: u32) -> bool {
        let before = self.gate(g).before;
        before != g && self.gate(before).state == State::Open && self.gate(before).before != g
    }

    fn can_close_right(&self, g: u32) -> bool {
        let behind = self.gate(g).next;
        behind != g && self.gate(behind).state == State::Open && self.gate(behind).next != g
    }

    fn code_op(&mut self, g: u32, a: u32, b: u32, op: Op) -> Result<Op, Impossible> {
        let about = Near {
            triangles: [self.around(a).triangles, self.around(b).triangles],
            left: self.can_close_left(g),
            right: self.can_close_right(g),
        };
        self.coder.op(about, self.latest()?, op)
    }

    fn latest(&self) -> Result<u32, Impossible> {
        count(&self.around).checked_sub(1).ok_or(Impossible)
    }

    fn new_vertex(&mut self, link: Link) -> Result<u32, Impossible> {
        let number = count(&self.around);
        if number >= self.limits.vertices {
            return Err(Impossible);
        }
        self.around.push(Around { triangles: 0, latest: NONE, other: NONE, gate: NONE });
        self.made.links.push(link);
        Ok(number)
    }

    #[cold]
    #[inline(never)]
    fn seed(&mut self) -> Result<(), Impossible> {
        let (wanted, patch) = self.source.seed().unwrap_or_default();
        let mut corners = [0; 3];
        let mut last = count(&self.around).checked_sub(1);
        for (corner, (v, k)) in corners.iter_mut().zip(wanted.into_iter().zip(0usize..)) {
            let is_new = self.around.is_empty() || self.coder.fresh(k, v as usize >= self.around.len());
            *corner = if is_new {
                self.new_vertex(Link::near(last.unwrap_or(NONE)))?
            } else {
                let latest = self.latest()?;
                self.coder.known(latest, v)?
            };
            last = Some(*corner);
        }
        let patch = self.code_any_patch(patch)?;
        let triangle = self.place(corners, patch);
        let [p, q, r] = corners;
        let gates =
            [self.open(p, r, 3 * triangle), self.open(q, p, 3 * triangle + 1), self.open(r, q, 3 * triangle + 2)];
        let [x, y, z] = gates;
        self.join(x, y);
        self.join(y, z);
        self.join(z, x);
        Ok(())
    }

    fn place(&mut self, corners: [u32; 3], patch: u32) -> u32 {
        for v in corners {
            if let Some(around) = self.around.get_mut(v as usize) {
                around.triangles = (around.triangles + 1).min(MAX_AT_VERTEX);
                if around.latest != patch {
                    around.other = around.latest;
                    around.latest = patch;
                }
            }
        }
        self.made.triangles.push(Placed { corners, patch });
        count(&self.made.triangles) - 1
    }

    fn patch_of(&self, edge: u32) -> u32 {
        self.made.triangles.get(edge as usize / 3).map_or(0, |t| t.patch)
    }

    /// The patch of a triangle beside one of `patch`.
    fn code_patch(&mut self, patch: u32, [a, b, c]: [u32; 3], new: bool, wanted: u32) -> Result<u32, Impossible> {
        if self.limits.patches == 1 {
            return Ok(0);
        }
        let [a, b, c] = [a, b, c].map(|v| self.around(v));
        let third = match (new, c.other == NONE, c.latest == patch) {
            (true, ..) => 0,
            (_, true, true) => 1,
            (_, true, false) => 2,
            _ => 3,
        };
        let context = usize::from(a.other != NONE) * 8 + usize::from(b.other != NONE) * 4 + third;
        if self.coder.same_patch(context, wanted == patch) {
            return Ok(patch);
        }
        self.code_other_patch(patch, [a, b, c], wanted)
    }

    /// The patch of a triangle that is not of its neighbour's.
    #[cold]
    #[inline(never)]
    fn code_other_patch(&mut self, patch: u32, [a, b, c]: [Around; 3], wanted: u32) -> Result<u32, Impossible> {
        let others = [c, b, a].map(|v| if v.latest == patch { v.other } else { v.latest });
        if let Some(guess) = others.into_iter().find(|&p| p != NONE)
            && self.coder.guess(wanted == guess)
        {
            return Ok(guess);
        }
        self.code_any_patch(wanted)
    }

    #[cold]
    #[inline(never)]
    fn code_any_patch(&mut self, patch: u32) -> Result<u32, Impossible> {
        let bits = 32 - self.limits.patches.saturating_sub(1).leading_zeros();
        let low = bits.min(10);
        let high = self.coder.raw(bits - low, patch >> low);
        let patch = high << low | self.coder.raw(low, patch & ((1 << low) - 1));
        if patch < self.limits.patches { Ok(patch) } else { Err(Impossible) }
    }

    /// Two triangles share an edge: the later vertex across it is predicted by the other.
    fn pair(&mut self, edge: [u32; 2], p: u32, q: u32) {
        let [a, b] = edge;
        let (v, across) = if p > q { (p, q) } else { (q, p) };
        if v <= a || v <= b || v == across {
            return;
        }
        if let Some(link) = self.made.links.get_mut(v as usize) {
            link.add(edge, across);
        }
    }
}
