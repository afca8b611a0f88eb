use pliant_cage::*; use pliant_mesh::{Silent, TriMesh, shapes}; use std::time::Instant;
fn off(path:&str)->TriMesh{ let t=std::fs::read_to_string(path).unwrap(); let t: String = t.lines().filter(|l|!l.starts_with('#')).collect::<Vec<_>>().join("\n"); let mut it=t.split_whitespace(); assert_eq!(it.next(),Some("OFF")); let n:usize=it.next().unwrap().parse().unwrap(); let m:usize=it.next().unwrap().parse().unwrap(); it.next(); let mut p=vec![]; for _ in 0..n{ let a:Vec<f64>=(0..3).map(|_|it.next().unwrap().parse().unwrap()).collect(); p.push(glam::DVec3::new(a[0],a[1],a[2])); } let mut f=vec![]; for _ in 0..m { let k:usize=it.next().unwrap().parse().unwrap(); let a:Vec<u32>=(0..k).map(|_|it.next().unwrap().parse().unwrap()).collect(); for i in 1..k-1 { f.push([a[0],a[i],a[i+1]]); } } TriMesh::new(p,f).unwrap() }
fn main(){
 let a:Vec<String>=std::env::args().collect();
 let shape = if a[1].ends_with(".off"){off(&a[1])} else {shapes::creature(a[1].parse().unwrap()).unwrap()};
 let frac:f64=a[2].parse().unwrap(); let check=a[3]=="check";
 let cage=simplify(&shape,&CageSize::Fraction(frac).into(),&Silent).unwrap().mesh;
 eprintln!("{} v, cage {} v {} f", shape.vertex_count(), cage.vertex_count(), cage.face_count());
 for _ in 0..if check{1}else{3} {
 let c=cpu(); let t=Instant::now(); let fast=Binding::new(&shape,&cage,&Prune::PAPER.into(),&Silent).unwrap();
 eprintln!("fast {:.3} s wall {:.3} cpu", t.elapsed().as_secs_f64(), cpu()-c);
 if check { let c=cpu(); let exact=Binding::new(&shape,&cage,&BindOptions{prune:Prune::PAPER,exact:true},&Silent).unwrap(); eprintln!("exact {:.3} cpu", cpu()-c);
  let (mut diff,mut worst,mut worst_rel)=(0,0.0f64,0.0f64); let mut edge=0.0f64;
  for i in 0..shape.vertex_count(){ let (ja,wa)=fast.row(i); let (jb,wb)=exact.row(i); let mut x:Vec<_>=ja.iter().zip(wa).collect(); let mut y:Vec<_>=jb.iter().zip(wb).collect(); x.sort_by_key(|e|e.0); y.sort_by_key(|e|e.0);
   let m:f32=wb.iter().map(|w|w.abs()).sum();
   if x.iter().map(|e|e.0).ne(y.iter().map(|e|e.0)) { diff+=1; let sm=wb.iter().map(|w|w.abs()).fold(f32::MAX,f32::min); if diff<6 {eprintln!("row {i}: {} vs {} smallest {sm}", x.len(), y.len());} }
   else { for (p,q) in x.iter().zip(&y){ let d=(p.1-q.1).abs() as f64; worst=worst.max(d); worst_rel=worst_rel.max(d/m as f64);} } let _=&mut edge; }
  eprintln!("support differs {diff}, worst weight diff {worst:.2e}, over magnitude {worst_rel:.2e}; unsafe {} replaced {}", exact.report().unsafe_rows, exact.report().replaced_rows);
 } } }
fn cpu()->f64{ let s=std::fs::read_to_string("/proc/self/stat").unwrap(); let f:Vec<&str>=s.rsplit(')').next().unwrap().split_whitespace().collect(); (f[11].parse::<f64>().unwrap()+f[12].parse::<f64>().unwrap())/100. }
