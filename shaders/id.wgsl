// Which draw covers a pixel, and at which depth: for picking and for tests. viewer/src/gpu/id.rs.
// Two unsigned integers: the number of the draw (0: nothing) and the bits of the depth.

struct IdOut {
    @invariant @builtin(position) clip: vec4<f32>,
}

@vertex
fn vertex(@location(0) position: vec3<i32>) -> IdOut {
    var out: IdOut;
    out.clip = frame.clip_from_cell * vec4<f32>(steps_from_cell(position), 1.0);
    return out;
}

@fragment
fn fragment(in: IdOut) -> @location(0) vec2<u32> {
    return vec2<u32>(draw.id, bitcast<u32>(in.clip.z));
}
