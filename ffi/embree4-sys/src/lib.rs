//! Bindings to the installed Embree, made from its own header: 3.13 and 4.x under one face.
//!
//! The two differ for us only in how a ray query gets its context; [`QueryContext`], [`intersect1`] and [`occluded1`] hide it.
//! Everything else is the C interface as it stands.

#![allow(non_camel_case_types, non_snake_case, non_upper_case_globals, clippy::all)]

include!(concat!(env!("OUT_DIR"), "/embree.rs"));

/// Version of the header these bindings were made from.
pub const HEADER_VERSION: (u32, u32, u32) = (RTC_VERSION_MAJOR, RTC_VERSION_MINOR, RTC_VERSION_PATCH);

/// "No geometry", "no instance" (the header has it as a cast, which bindgen does not carry over).
pub const INVALID_ID: u32 = u32::MAX;

/// What Embree hands on to the callbacks. An extended context has it as its first field.
#[cfg(embree = "3")]
pub type QueryContext = RTCIntersectContext;
/// What Embree hands on to the callbacks. An extended context has it as its first field.
#[cfg(embree = "4")]
pub type QueryContext = RTCRayQueryContext;

/// A context for incoherent rays outside any instance (the header's own initialiser is inline).
#[inline]
pub fn query_context() -> QueryContext {
    // SAFETY: plain C structs of integers, floats and nullable function pointers; all zero bits are valid.
    let mut c: QueryContext = unsafe { core::mem::zeroed() };
    #[cfg(embree = "3")]
    {
        c.flags = RTCIntersectContextFlags::RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    }
    // Embree 4.3 grew `instPrimID` beside `instID`: set all ids, however many, by the struct's own size.
    #[cfg(embree = "4")]
    {
        let ids = core::mem::size_of::<QueryContext>() / 4;
        // SAFETY: the struct holds nothing but u32 with RTC_MAX_INSTANCE_LEVEL_COUNT == 1, which is asserted below.
        unsafe { core::ptr::write_bytes(&raw mut c as *mut u32, 0xff, ids) };
    }
    #[cfg(embree = "3")]
    {
        c.instID = [INVALID_ID; RTC_MAX_INSTANCE_LEVEL_COUNT as usize];
    }
    c
}

/// A context for point queries outside any instance (the header's own initialiser is inline).
#[inline]
pub fn point_query_context() -> RTCPointQueryContext {
    // SAFETY: a plain C struct of integers and floats; all zero bits are valid.
    let mut c: RTCPointQueryContext = unsafe { core::mem::zeroed() };
    // 4.3's `instPrimID` stays 0: nobody reads it on an empty stack.
    c.instID = [INVALID_ID; RTC_MAX_INSTANCE_LEVEL_COUNT as usize];
    c
}

const _: () = assert!(RTC_MAX_INSTANCE_LEVEL_COUNT == 1, "an Embree with several instance levels has another context");

/// Nearest hit of one ray.
///
/// # Safety
/// As `rtcIntersect1`: a committed scene, a context and a ray with hit that live through the call; the ray is valid.
#[inline]
pub unsafe fn intersect1(scene: RTCScene, context: *mut QueryContext, rayhit: *mut RTCRayHit) {
    #[cfg(embree = "3")]
    // SAFETY: the caller's promise.
    unsafe {
        rtcIntersect1(scene, context, rayhit)
    }
    #[cfg(embree = "4")]
    // SAFETY: the caller's promise; the arguments are plain data, zero where not set.
    unsafe {
        let mut a: RTCIntersectArguments = core::mem::zeroed();
        a.feature_mask = RTCFeatureFlags::RTC_FEATURE_FLAG_ALL;
        a.context = context;
        rtcIntersect1(scene, rayhit, &mut a)
    }
}

/// Any hit of one ray: `tfar` is -infinity afterwards if there is one.
///
/// # Safety
/// As `rtcOccluded1`: a committed scene, a context and a ray that live through the call; the ray is valid.
#[inline]
pub unsafe fn occluded1(scene: RTCScene, context: *mut QueryContext, ray: *mut RTCRay) {
    #[cfg(embree = "3")]
    // SAFETY: the caller's promise.
    unsafe {
        rtcOccluded1(scene, context, ray)
    }
    #[cfg(embree = "4")]
    // SAFETY: the caller's promise; the arguments are plain data, zero where not set.
    unsafe {
        let mut a: RTCOccludedArguments = core::mem::zeroed();
        a.feature_mask = RTCFeatureFlags::RTC_FEATURE_FLAG_ALL;
        a.context = context;
        rtcOccluded1(scene, ray, &mut a)
    }
}
