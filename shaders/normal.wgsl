// Directions in octahedral coordinates (Meyer et al. 2010). Behind frame.wgsl in the passes that need normals.

// snorm16 has mapped -32767..32767 to -1..1 already.
fn direction_from_octahedral(o: vec2<f32>) -> vec3<f32> {
    let z = 1.0 - abs(o.x) - abs(o.y);
    let fold = vec2<f32>(
        (1.0 - abs(o.y)) * select(-1.0, 1.0, o.x >= 0.0),
        (1.0 - abs(o.x)) * select(-1.0, 1.0, o.y >= 0.0),
    );
    return normalize(vec3<f32>(select(o, fold, z < 0.0), z));
}

fn packed_from_direction(n: vec3<f32>) -> u32 {
    let o = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
    let fold = vec2<f32>(
        (1.0 - abs(o.y)) * select(-1.0, 1.0, o.x >= 0.0),
        (1.0 - abs(o.x)) * select(-1.0, 1.0, o.y >= 0.0),
    );
    let unit = clamp(select(o, fold, n.z < 0.0) * 0.5 + 0.5, vec2<f32>(0.0), vec2<f32>(1.0));
    let bits = vec2<u32>(round(unit * 65535.0));
    return bits.x | (bits.y << 16u);
}

fn direction_from_packed(bits: u32) -> vec3<f32> {
    let unit = vec2<f32>(f32(bits & 0xffffu), f32(bits >> 16u)) / 65535.0;
    return direction_from_octahedral(unit * 2.0 - 1.0);
}
