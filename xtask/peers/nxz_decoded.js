// Print the SHA-256 of the triangles of compressed Nexus files as Corto's JavaScript decoder gives them, for formats/tests/nexus/SHA256.
//
//     node nxz_decoded.js FILE.nxz…
//
// The current folder must hold attribute.js, tunstall.js and cortodecoder.js of github.com/cnr-isti-vclab/corto (html/js, MIT, 0d624d5).
const fs=require('fs'),vm=require('vm'),crypto=require('crypto');
for(const f of ['attribute','tunstall','cortodecoder']) vm.runInThisContext(fs.readFileSync(f+'.js','utf8'));
for(const name of process.argv.slice(2)){
const b=fs.readFileSync(name), n=b.readUInt32LE(0x3c); const T=[];
for(let i=0;i<n-1;i++){const o=88+44*i;
 const off=256*b.readUInt32LE(o),end=256*b.readUInt32LE(o+44),fp=b.readUInt32LE(o+40),ep=b.readUInt32LE(o+84);
 let leaf=true;for(let p=fp;p<ep;p++)if(b.readUInt32LE(88+44*n+12*p)!=n-1)leaf=false;
 if(!leaf)continue;
 const m=new CortoDecoder(b.buffer.slice(b.byteOffset+off,b.byteOffset+end)).decode();
 const corner=v=>{const r=Buffer.alloc(15);for(let k=0;k<3;k++){r.writeFloatLE(m.position[3*v+k]+0,4*k);if(m.color)r[12+k]=m.color[3*v+k];}return r;};
 for(let t=0;t<m.nface;t++){const c=[0,1,2].map(k=>corner(m.index[3*t+k]));
  let first=0;for(const k of [1,2])if(Buffer.compare(c[k],c[first])<0)first=k;
  T.push(Buffer.concat([0,1,2].map(k=>c[(first+k)%3])));}}
T.sort(Buffer.compare);
console.log(crypto.createHash('sha256').update(Buffer.concat(T)).digest('hex')+"  "+name);
}
