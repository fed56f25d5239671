//! One primitive of one node: its vertices in the coordinates of the scene with their colours, and its triangles.

use super::super::texture::{Refusal, Texture as Picture, Textures, light_from_srgb, srgb_from_light};
use super::super::{MeshSink, ReadError, ReadOptions, VertexBlock};
use super::Context;
use super::accessor::{Accessor, Component};
use super::buffers::{self, Buffers};
use super::detailed::{Detailing, Run};
use super::draco::Decoded;
use super::material::{Material, Texture};
use super::schema::{Primitive, Root};
use super::strip::{Assembler, Mode};
use super::transform::Transform;
use glam::{DVec2, DVec3, Vec3};
use kilwa_pack::plural::counted;
use std::collections::HashMap;

/// Elements read at a time.
const BLOCK: u64 = 1 << 16;

/// Diagnostic: a primitive that is no surface.
const NO_SURFACE: &str = "primitives of points or lines left out";

/// What is needed beside the primitive in hand.
pub(super) struct Delivery<'r, 's, 'a> {
    pub(super) root: &'r Root,
    pub(super) buffers: Buffers<'a>,
    pub(super) sink: &'s mut dyn MeshSink,
    pub(super) context: Context<'r>,
    textures: Textures,
    /// Whether every vertex gets a colour, because some have one that is not white.
    pub(super) colored: bool,
    /// Where triangles are split, or their edges noted.
    detailing: Option<Detailing<'r>>,
    triangles: u64,
}

/// Vertices of a node that were delivered: by the accessors and the material, the first number.
pub(super) type Known = HashMap<(Vec<Option<usize>>, Option<usize>), u64>;

/// The values of one attribute.
pub(super) struct Column {
    values: Values,
    width: usize,
    /// Integers of this type represent 0 to 1 or -1 to 1.
    normalise: Option<Component>,
}

enum Values {
    Stored(Accessor),
    Ready(Vec<f32>),
}

/// The attributes of a primitive that are kept.
pub(super) struct Columns {
    pub(super) count: u64,
    pub(super) positions: Column,
    pub(super) normals: Option<Column>,
    pub(super) colors: Option<Column>,
    pub(super) coordinates: Option<Column>,
}

/// Takes a block of triangles away.
type Take<'t, D> = dyn FnMut(&mut D, &mut Vec<[u64; 3]>) -> Result<(), ReadError> + 't;

/// Where the vertices of triangles come from.
enum Order {
    /// An accessor of indices.
    Indexed(usize),
    /// One after the other.
    Plain,
    /// Triangles as they are.
    Ready(Vec<[u64; 3]>),
}

impl<'r, 's, 'a> Delivery<'r, 's, 'a> {
    pub(super) fn new(
        root: &'r Root,
        buffers: Buffers<'a>,
        sink: &'s mut dyn MeshSink,
        context: Context<'r>,
        colored: bool,
        options: &ReadOptions,
        detailing: Option<Detailing<'r>>,
    ) -> Self {
        let textures = Textures::new(options.texture_bytes).keeping(options.memory / 2).within(options.picture);
        Self { root, buffers, sink, context, textures, colored, detailing, triangles: 0 }
    }

    /// Triangles delivered.
    pub(super) fn triangles(&self) -> u64 {
        self.triangles
    }

    /// Deliver one primitive; `part` is its name in messages.
    pub(super) fn primitive(
        &mut self,
        primitive: &Primitive,
        part: &str,
        transform: &Transform,
        known: &mut Known,
    ) -> Result<(), ReadError> {
        let Some(mode) = Mode::of(primitive.mode) else {
            if primitive.mode <= 3 {
                self.sink.diagnostics().add(NO_SURFACE, || part.to_owned());
                return Ok(());
            }
            let found = format!("the mode {}", primitive.mode);
            return Err(self.context.part(part.to_owned(), found, "a mode of 0 to 6"));
        };
        if !primitive.attributes.contains_key("POSITION") {
            self.sink.diagnostics().add("primitives without positions left out", || part.to_owned());
            return Ok(());
        }
        if !primitive.targets.is_empty() {
            self.sink.diagnostics().add("primitives with morph targets taken as they stand", || part.to_owned());
        }
        let material = Material::of(self.root, primitive, part, &self.context)?;
        if self.detailing.is_some_and(|d| d.notes) && material.texture.is_none() {
            return Ok(());
        }
        let (columns, order) = if let Some(draco) = &primitive.extensions.draco {
            let decoded = Decoded::open(self.root, &mut self.buffers, draco, part.to_owned(), &self.context)?;
            let columns = self.decoded_columns(primitive, &decoded, &material, part)?;
            (columns, Order::Ready(decoded.triangles(&self.context)?))
        } else {
            let order = primitive.indices.map_or(Order::Plain, Order::Indexed);
            (self.stored_columns(primitive, &material, part)?, order)
        };
        let count = columns.count;
        // A Draco stream has triangles, whatever the mode of the primitive.
        let mode = if matches!(order, Order::Ready(_)) { Mode::List } else { mode };
        let assembler = Assembler::new(mode, transform.mirrors());
        if let Some(detailing) = self.detailing {
            let size = self.picture_size(material.texture.as_ref());
            let mut run = Run::new(columns, &material, transform, size);
            let mut split = |this: &mut Self, t: &mut Vec<[u64; 3]>| this.detail_block(&mut run, t, detailing);
            self.triangles_of(order, assembler, 0, count, part, &mut split)?;
            return self.hand_on(&mut run, 0);
        }
        let used = |name: &str| primitive.attributes.get(name).copied();
        let coordinates = material.texture.as_ref().and_then(|t| used(&t.attribute));
        let key = (vec![used("POSITION"), used("NORMAL"), used("COLOR_0"), coordinates], primitive.material);
        let shareable = !matches!(order, Order::Ready(_));
        let first = if let Some(first) = known.get(&key).filter(|_| shareable) {
            *first
        } else {
            let first = self.vertices(columns, &material, part, transform)?;
            if shareable {
                known.insert(key, first);
            }
            first
        };
        self.triangles_of(order, assembler, first, count, part, &mut |this, t| this.deliver(t))
    }

    fn stored_columns(&mut self, from: &Primitive, material: &Material, part: &str) -> Result<Columns, ReadError> {
        let mut open = |name: &str, widths: &[usize]| {
            let Some(&index) = from.attributes.get(name) else { return Ok(None) };
            let accessor = Accessor::open(self.root, &mut self.buffers, index, &self.context)?;
            if !widths.contains(&accessor.width) {
                let found = format!("{} of {name}", counted(accessor.width, "component", "components"));
                return Err(self.context.part(format!("accessors[{index}]"), found, &format!("one of {widths:?}")));
            }
            Ok(Some(accessor))
        };
        let positions = open("POSITION", &[3])?;
        let normals = open("NORMAL", &[3])?;
        let colors = if self.colored { open("COLOR_0", &[3, 4])? } else { None };
        let coordinates = match &material.texture {
            Some(texture) => open(&texture.attribute, &[2])?,
            None => None,
        };
        let Some(positions) = positions else {
            return Err(self.context.part(part.to_owned(), "no positions".to_owned(), "positions"));
        };
        let count = positions.count;
        for other in [&normals, &colors, &coordinates].into_iter().flatten() {
            if other.count != count {
                let found = format!(
                    "{} for {}",
                    counted(other.count, "element", "elements"),
                    counted(count, "position", "positions")
                );
                return Err(self.context.part(format!("accessors[{}]", other.index), found, "one for each position"));
            }
        }
        let column = |accessor: Accessor, always: bool| Column {
            width: accessor.width,
            normalise: (accessor.normalized || always).then_some(accessor.component),
            values: Values::Stored(accessor),
        };
        Ok(Columns {
            count,
            positions: column(positions, false),
            normals: normals.map(|a| column(a, true)),
            // The specification wants integer colours to be normalised; some writers forget to say so.
            colors: colors.map(|a| column(a, true)),
            coordinates: coordinates.map(|a| column(a, false)),
        })
    }

    fn decoded_columns(
        &self,
        from: &Primitive,
        decoded: &Decoded,
        material: &Material,
        part: &str,
    ) -> Result<Columns, ReadError> {
        let ids = from.extensions.draco.as_ref().map(|d| &d.attributes);
        let open = |name: &str, widths: &[usize], always: bool| {
            let Some(&id) = ids.and_then(|ids| ids.get(name)) else { return Ok(None) };
            let (width, values) = decoded.values(id, &self.context)?;
            if !widths.contains(&width) {
                let found = format!("{} of {name} in its Draco stream", counted(width, "component", "components"));
                return Err(self.context.part(part.to_owned(), found, &format!("one of {widths:?}")));
            }
            let about = from.attributes.get(name).and_then(|&i| self.root.accessors.get(i));
            let normalise = about.filter(|a| a.normalized || always).and_then(|a| Component::of(a.component_type));
            Ok(Some(Column { values: Values::Ready(values), width, normalise }))
        };
        let Some(positions) = open("POSITION", &[3], false)? else {
            let found = "no positions in its Draco stream".to_owned();
            return Err(self.context.part(part.to_owned(), found, "positions; export the file again"));
        };
        Ok(Columns {
            count: decoded.vertex_count(),
            positions,
            normals: open("NORMAL", &[3], true)?,
            colors: if self.colored { open("COLOR_0", &[3, 4], true)? } else { None },
            coordinates: match &material.texture {
                Some(texture) => open(&texture.attribute, &[2], false)?,
                None => None,
            },
        })
    }

    /// Deliver the vertices; the number of the first.
    fn vertices(
        &mut self,
        mut columns: Columns,
        material: &Material,
        part: &str,
        transform: &Transform,
    ) -> Result<u64, ReadError> {
        let first = self.sink.vertex_count();
        if material.texture.is_some() && columns.coordinates.is_none() {
            let kind = "primitives with a picture and no texture coordinates; the picture is left out";
            self.sink.diagnostics().add(kind, || part.to_owned());
        }
        let (mut values, mut linear) = (Vec::new(), Vec::new());
        let mut at = 0;
        while at < columns.count {
            let n = (columns.count - at).min(BLOCK) as usize;
            columns.positions.block(&mut self.buffers, at, n, &mut values, &self.context)?;
            let positions: Vec<DVec3> = triples(&values).map(|p| transform.point(p)).collect();
            let mut normals: Vec<Vec3> = Vec::new();
            if let Some(column) = &mut columns.normals {
                column.block(&mut self.buffers, at, n, &mut values, &self.context)?;
                normals.extend(triples(&values).map(|v| transform.normal(v).as_vec3()));
            }
            let mut colors: Vec<[u8; 3]> = Vec::new();
            if self.colored {
                linear.clear();
                linear.resize(n, material.factor);
                if let Some(column) = &mut columns.colors {
                    column.block(&mut self.buffers, at, n, &mut values, &self.context)?;
                    for (color, value) in linear.iter_mut().zip(values.chunks_exact(column.width)) {
                        *color *=
                            DVec3::new(value[0].clamp(0.0, 1.0), value[1].clamp(0.0, 1.0), value[2].clamp(0.0, 1.0));
                    }
                }
                if let (Some(texture), Some(column)) = (&material.texture, &mut columns.coordinates) {
                    column.block(&mut self.buffers, at, n, &mut values, &self.context)?;
                    self.paint(texture, &values, &mut linear);
                }
                colors.extend(linear.iter().map(|c| c.to_array().map(srgb_from_light)));
            }
            let block = VertexBlock { positions: &positions, colors: &colors, normals: &normals, scalars: &[] };
            self.sink.vertices(&block)?;
            at += n as u64;
        }
        Ok(first)
    }

    /// Multiply with the picture at the texture coordinates.
    fn paint(&mut self, texture: &Texture, coordinates: &[f64], linear: &mut [DVec3]) {
        let Some(picture) = self.picture(texture) else { return };
        for (color, uv) in linear.iter_mut().zip(coordinates.chunks_exact(2)) {
            let texel = picture.sample(texture.place(DVec2::from_slice(uv)), texture.wrap);
            *color *= DVec3::from_array(texel.map(light_from_srgb));
        }
    }

    /// The decoded picture of a texture; where it cannot be had, that is counted once.
    pub(super) fn picture(&mut self, texture: &Texture) -> Option<&Picture> {
        let (root, buffers, context) = (self.root, &mut self.buffers, &self.context);
        let max = self.textures.file_bytes();
        let load = || image_bytes(root, texture.image, buffers, max, context);
        let diagnostics = self.sink.diagnostics();
        self.textures.get(texture.image, load, |why| {
            let kind = "pictures that cannot be read; what they cover has the colour of its material";
            diagnostics.add(kind, || format!("images[{}]: {why}", texture.image));
        })
    }

    /// Count the pictures that were used.
    pub(super) fn count_pictures(&mut self) {
        self.sink.diagnostics().pictures.add(self.textures.used());
    }

    /// Make the triangles, numbers from `first` on, and give them to `take` in blocks.
    fn triangles_of(
        &mut self,
        order: Order,
        mut assembler: Assembler,
        first: u64,
        count: u64,
        part: &str,
        take: &mut Take<'_, Self>,
    ) -> Result<(), ReadError> {
        let mut triangles = Vec::new();
        match order {
            Order::Ready(ready) => {
                triangles.extend(ready.iter().flatten().filter_map(|v| assembler.push(first + v)));
            }
            Order::Plain => {
                for v in 0..count {
                    triangles.extend(assembler.push(first + v));
                    if triangles.len() as u64 >= BLOCK {
                        take(self, &mut triangles)?;
                    }
                }
            }
            Order::Indexed(index) => {
                let mut indices = Accessor::open(self.root, &mut self.buffers, index, &self.context)?;
                indices.check_indices(&self.context)?;
                let mut values = Vec::new();
                let mut at = 0;
                while at < indices.count {
                    let n = (indices.count - at).min(BLOCK) as usize;
                    indices.block(&mut self.buffers, at, n, &mut values, &self.context)?;
                    for (place, &value) in (at..).zip(&values) {
                        let v = value as u64;
                        if v >= count {
                            let found = format!("the vertex {v} at index {place}");
                            let expected =
                                format!("vertices below {count}, the positions of {part}; copy or export it again");
                            return Err(self.context.part(format!("accessors[{index}]"), found, &expected));
                        }
                        triangles.extend(assembler.push(first + v));
                    }
                    take(self, &mut triangles)?;
                    at += n as u64;
                }
            }
        }
        take(self, &mut triangles)?;
        if assembler.is_incomplete() {
            let kind = "primitives whose last indices make no triangle; they are left out";
            self.sink.diagnostics().add(kind, || part.to_owned());
        }
        Ok(())
    }

    pub(super) fn deliver(&mut self, triangles: &mut Vec<[u64; 3]>) -> Result<(), ReadError> {
        if let Some(why) = self.textures.short() {
            let what = format!("a picture of it: {why}");
            return Err(ReadError::TooLarge { file: self.context.path.to_owned(), what });
        }
        if !triangles.is_empty() {
            self.sink.triangles(triangles, &[])?;
            self.triangles += triangles.len() as u64;
            triangles.clear();
        }
        Ok(())
    }
}

impl Column {
    /// Components of an element.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// `count` elements from element `first` on, in place of what `into` has.
    pub(super) fn block(
        &mut self,
        buffers: &mut Buffers<'_>,
        first: u64,
        count: usize,
        into: &mut Vec<f64>,
        context: &Context<'_>,
    ) -> Result<(), ReadError> {
        match &mut self.values {
            Values::Stored(accessor) => accessor.block(buffers, first, count, into, context)?,
            Values::Ready(values) => {
                let from = first as usize * self.width;
                let part = values.get(from..from + count * self.width).unwrap_or_default();
                into.clear();
                into.extend(part.iter().map(|v| f64::from(*v)));
            }
        }
        if let Some(component) = self.normalise {
            for v in into {
                *v = component.normalise(*v);
            }
        }
        Ok(())
    }
}

fn triples(values: &[f64]) -> impl Iterator<Item = DVec3> + '_ {
    values.chunks_exact(3).map(DVec3::from_slice)
}

/// The encoded bytes of a picture, no more than `most`.
fn image_bytes(
    root: &Root,
    index: usize,
    buffers: &mut Buffers<'_>,
    max: u64,
    context: &Context<'_>,
) -> Result<Vec<u8>, Refusal> {
    let none = |why: &str| Refusal::Unreadable(why.to_owned());
    let image = root.images.get(index).ok_or_else(|| none("there is no such image"))?;
    let text = |e: ReadError| none(&e.to_string());
    if let Some(view) = image.buffer_view {
        let view = buffers.view(root, view, context).map_err(text)?;
        if view.len() > max {
            let why = format!(
                "images[{index}] has {} bytes, of which only {max} fit in memory; give a larger --memory",
                view.len()
            );
            return Err(Refusal::Memory(why));
        }
        return buffers.whole(&view, context).map_err(text);
    }
    let uri = image.uri.as_ref().ok_or_else(|| none("it has neither a uri nor a bufferView"))?;
    let part = format!("images[{index}]");
    if let Some(bytes) = buffers::data_uri(uri, &part, context).map_err(text)? {
        return Ok(bytes);
    }
    let path = buffers::locate(uri, &part, context).map_err(text)?;
    context.companions.read(&path, max).map_err(|e| Refusal::of_file(&path, &e))
}
