// Curvature and eye-dome lighting from the depth and normal buffer. Part of the surface pass.
// Both are measured over a distance, in metres or in pixels, and never over a triangle: they look the same at every level of detail.

const DIRECTIONS: i32 = 4;

// Half a turn in four steps; the other half are the opposite pixels.
fn direction(k: i32) -> vec2<f32> {
    switch k {
        case 0: {
            return vec2<f32>(1.0, 0.0);
        }
        case 1: {
            return vec2<f32>(0.70710678, 0.70710678);
        }
        case 2: {
            return vec2<f32>(0.0, 1.0);
        }
        default: {
            return vec2<f32>(-0.70710678, 0.70710678);
        }
    }
}

fn depth_along_axis(d: f32) -> f32 {
    return select(frame.depth.y - d * frame.depth.z, frame.depth.x / max(d, 1e-30), frame.depth.w > 0.5);
}

fn has_texel(pixel: vec2<i32>) -> bool {
    let size = vec2<i32>(textureDimensions(depth_normal));
    return all(pixel >= vec2<i32>(0)) && all(pixel < size);
}

// How much nearer the surroundings are, 0 to 1: the second difference of the depth value, which is affine in the picture on every
// plane, in perspective as in parallel projection. So planes are neutral at any tilt.
fn eye_dome(pixel: vec2<i32>, d: f32) -> f32 {
    let z = depth_along_axis(d);
    let steps_per_pixel = frame.right.w * z + frame.up.w;
    // Steps along the axis per change of the depth value.
    let steps = select(frame.depth.z, z / max(d, 1e-30), frame.depth.w > 0.5);
    var sum = 0.0;
    var count = 0.0;
    for (var ring = 1; ring <= 2; ring++) {
        let radius = max(frame.radius * f32(ring) * 0.5, 1.0);
        for (var k = 0; k < DIRECTIONS; k++) {
            let offset = vec2<i32>(round(direction(k) * radius));
            if has_texel(pixel + offset) && has_texel(pixel - offset) {
                let da = bitcast<f32>(textureLoad(depth_normal, pixel + offset, 0).x);
                let db = bitcast<f32>(textureLoad(depth_normal, pixel - offset, 0).x);
                let nearer = max(0.5 * (da + db) - d, 0.0) * steps / (radius * steps_per_pixel);
                // Below a tenth of a pixel's width it may be the triangulation.
                let seen = max(nearer - 0.1, 0.0);
                sum += seen / (1.0 + seen);
                count += 1.0;
            }
        }
    }
    return sum / max(count, 1.0);
}

// Mean curvature times the size of a feature: positive on ridges, negative in hollows, 1 on a ball of that radius. The chord
// between two opposite pixels and the change of the normal along it give the curvature at any tilt.
fn curvature(pixel: vec2<i32>, d: f32) -> f32 {
    let z = depth_along_axis(d);
    let steps_per_pixel = frame.right.w * z + frame.up.w;
    let pixels = clamp(frame.feature / steps_per_pixel, 1.0, 24.0);
    let forward = cross(frame.up.xyz, frame.right.xyz);
    var sum = 0.0;
    var count = 0.0;
    for (var ring = 1; ring <= 2; ring++) {
        for (var k = 0; k < DIRECTIONS; k++) {
            let offset = vec2<i32>(round(direction(k) * max(pixels * f32(ring) * 0.5, 1.0)));
            if has_texel(pixel + offset) && has_texel(pixel - offset) {
                let a = textureLoad(depth_normal, pixel + offset, 0).xy;
                let b = textureLoad(depth_normal, pixel - offset, 0).xy;
                let za = depth_along_axis(bitcast<f32>(a.x));
                let zb = depth_along_axis(bitcast<f32>(b.x));
                let across = vec2<f32>(offset) * 2.0 * steps_per_pixel;
                // Beyond a depth step there is another surface.
                let is_one_surface = a.x != 0u && b.x != 0u && abs(za + zb - 2.0 * z) < 2.0 * length(across);
                if is_one_surface {
                    let chord = across.x * frame.right.xyz - across.y * frame.up.xyz + (za - zb) * forward;
                    let turn = direction_from_packed(a.y) - direction_from_packed(b.y);
                    sum += dot(turn, chord) / dot(chord, chord);
                }
                count += 1.0;
            }
        }
    }
    return sum / max(count, 1.0) * frame.feature;
}
