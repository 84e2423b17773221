# One injection through the shared library, with nothing but Julia's own ccall:  julia example.jl

const HERE = @__DIR__
const LIBRARY = let found = [joinpath(folder, file) for (folder, _, files) in walkdir(HERE) for file in files]
    first(filter(path -> any(endswith.(path, (".so", ".dll", ".dylib"))), found))
end
const PARAMETERS, CHANNELS = 0, 0

struct Boundary
    rail_pressure::Cdouble
    cylinder_pressure::Cdouble
    return_pressure::Cdouble
    drive::Cdouble
end

struct Energising
    start::Cdouble
    duration::Cdouble
end

function main()
    parameters, channels, step = zeros(PARAMETERS), zeros(CHANNELS), 1e-6
    ccall((:cr_defaults, LIBRARY), Cvoid, (Ptr{Cdouble},), parameters)
    size = ccall((:cr_state_size, LIBRARY), Csize_t, (Ptr{Cdouble}, Cdouble), parameters, step)
    state = zeros(Cdouble, cld(size, sizeof(Cdouble)))
    boundary = Ref(Boundary(160e6, 5e6, 0.5e6, 0.0))
    status = ccall(
        (:cr_begin, LIBRARY),
        Cint,
        (Ptr{Cdouble}, Csize_t, Ptr{Cdouble}, Ref{Boundary}, Cdouble, Cdouble),
        state, size, parameters, boundary, step, 0.0,
    )
    if status == 0
        energising = Ref(Energising(0.0, 700e-6))
        status = ccall((:cr_plan, LIBRARY), Cint, (Ptr{Cdouble}, Ref{Energising}, Cint), state, energising, 1)
    end
    for k in 1:300
        status == 0 || break
        status = ccall((:cr_march, LIBRARY), Cint, (Ptr{Cdouble}, Int64, Ref{Boundary}), state, 10, boundary)
        ccall((:cr_observe, LIBRARY), Cvoid, (Ptr{Cdouble}, Ptr{Cdouble}), state, channels)
        injected, lift = round(channels[1] * 1e6; digits = 3), round(channels[4] * 1e6; digits = 1)
        println("$(10k) us: injected $injected mg, needle lift $lift um")
    end
    if status == 0
        status = ccall((:cr_status, LIBRARY), Cint, (Ptr{Cdouble},), state)
    end
    println(unsafe_string(ccall((:cr_sentence, LIBRARY), Cstring, (Cint,), status)))
end

main()
