#!/usr/bin/env python3
"""Make the compressed Nexus files of formats/tests/nexus, in the current folder, with pymeshlab (2025.7).

    nxz_files.py

Ten small shapes, each with and without colours, in several nodes, with 10 to 16 bits for positions or as the program chooses.
"""

import math, random, struct, pymeshlab as ml
random.seed(5)
def ply(path, v, f, c):
    with open(path,'wb') as o:
        h=f"ply\nformat binary_little_endian 1.0\nelement vertex {len(v)}\nproperty float x\nproperty float y\nproperty float z\n"
        if c: h+="property uchar red\nproperty uchar green\nproperty uchar blue\n"
        o.write((h+f"element face {len(f)}\nproperty list uchar int vertex_indices\nend_header\n").encode())
        for i,p in enumerate(v):
            o.write(struct.pack('<3f',*p)); 
            if c: o.write(bytes(c[i]))
        for t in f: o.write(struct.pack('<B3i',3,*t))
def grid(n,m,at,keep=lambda i,j:True):
    v=[at(i/n,j/m) for j in range(m+1) for i in range(n+1)]
    f=[]
    for j in range(m):
        for i in range(n):
            if keep(i,j):
                a=j*(n+1)+i; f+= [(a,a+1,a+n+2),(a,a+n+2,a+n+1)]
    return v,f
def wave(u,v): return (u*4,v*3,0.3*math.sin(9*u)*math.cos(7*v))
def flat(u,v): return (u,v,0)
def ball(u,v):
    a,b=2*math.pi*u,math.pi*(0.02+0.96*v); return (math.sin(b)*math.cos(a),math.sin(b)*math.sin(a),math.cos(b))
def rough(u,v): return (u*10,v*10,random.random()*2)
def far(u,v): return (1000+u,2000+v,300+0.1*math.sin(20*u))
def tiny(u,v): return (u*1e-3,v*1e-3,1e-4*math.sin(6*u))
shapes=[('wave',grid(16,12,wave)),('flat',grid(12,12,flat)),('ball',grid(20,12,ball)),('rough',grid(14,14,rough)),('far',grid(12,10,far)),('tiny',grid(12,10,tiny)),
 ('holes',grid(16,14,wave,lambda i,j:(i*7+j*3)%11>1)),('chequer',grid(14,12,flat,lambda i,j:(i+j)%2==0)),
 ('islands',grid(18,15,wave,lambda i,j:i%6!=5 and j%5!=4)),('strip',grid(120,1,wave))]
n=0
for k,(name,(v,f)) in enumerate(shapes):
    used=sorted({i for t in f for i in t}); new={o:i for i,o in enumerate(used)}
    v=[v[i] for i in used]; f=[tuple(new[i] for i in t) for t in f]
    for colours in (True,False):
        c=[tuple((i*37+k*50)%256 if name!='flat' else 200 for k in range(3)) for i in range(len(v))] if colours else None
        base=f"{name}{'-coloured' if colours else ''}"
        ply(base+'.ply',v,f,c)
        ms=ml.MeshSet()
        ms.apply_filter('nxs_build',input_file=base+'.ply',output_file=base+'.nxs',node_faces=128,top_node_faces=64)
        ms.apply_filter('nxs_compress',input_file=base+'.nxs',output_file=base+'.nxz',vertex_bits=[0,10,12,14,16][n%5],luma_bits=6+n%3,chroma_bits=5+n%4,normal_bits=[8,10,12][n%3])
        n+=1
print(n)
