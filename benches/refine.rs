use std::error::Error;
use std::path::Path;
use std::time::Instant;
use pliant::*;
use pliant::glam::DVec3;

fn main() -> Result<(), Box<dyn Error>> {
    for name in std::env::args().skip(1).filter(|a| !a.starts_with('-')) {
        let shape = match name.strip_prefix("creature:") {
            Some(v) => creature(v.parse()?)?,
            None => read(Path::new(&name))?.mesh,
        };
        let mut scene = Scene::auto(&shape.bounds());
        if let Some(m) = scene.handles.last_mut().and_then(|h| h.motion.as_mut()) { if let Some(t) = &mut m.rotate { t.degrees = 60.0; } }
        let resolved = scene.resolve(&shape)?;
        let n = shape.vertex_count();
        let handles: Vec<Handle> = resolved.handles.iter().map(|h| Handle::hard(h.vertices.clone())).collect();
        let (region, _) = Region::new(n, &VertexSet::all(n), &handles)?.without_unconstrained(shape.topology());
        let goals = Goals::new(resolved.goals(1.0));
        let err = |p: &[DVec3]| edge_errors(shape.topology(), &shape.positions, p).rms_relative;
        let t = Instant::now();
        let mut arap = pliant_deform::arap::Arap::prepare(&ArapOptions::converged(), &shape, &region)?;
        let prep = t.elapsed();
        let mut direct = shape.positions.clone();
        let t = Instant::now();
        let report = arap.solve(&goals, &mut direct)?;
        let solve = t.elapsed();
        let e = arap.energy(&goals, &direct)?;
        println!("{name} {n} direct: prepare {prep:?} solve {solve:?} its {} energy {e:.4e} err {:.4} times {:?}", report.iterations, err(&direct), arap.step_times());
        // hybrid
        let study = Study::new(name.clone(), &shape, &scene)?;
        let caged = study.cage(SweepSize::Cage(CageSize::Fraction(0.05)), &Silent)?;
        let bound = study.bind(&caged, BindOptions::default(), &Silent)?;
        let dragged = study.drag(&caged, &Method::default(), Schedule{steps:1, iterations: Iterations::Count(2), start: StartFrom::Levels}, &Silent)?;
        let (mut pose, _) = study.carry(&caged, &bound, &dragged, Propagation::Frames, &Silent);
        let preview = pose.clone();
        for h in &resolved.handles.iter().zip(&goals.transforms).collect::<Vec<_>>() { for v in h.0.vertices.iter() { pose[v as usize] = h.1.apply(shape.positions[v as usize]); } }
        let e0 = arap.energy(&goals, &pose)?;
        println!("   hybrid energy {:.3} err {:.3}", e0/e, err(&pose)/err(&direct));
        let total = (prep+solve).as_secs_f64();
        for solver in [GlobalSolver::Factor, GlobalSolver::Multigrid] {
            let t0 = Instant::now();
            let mut r = Refiner::prepare(&shape, &region, &RefineOptions{solver, ..RefineOptions::default()})?;
            let t1=t0.elapsed();
            r.begin(&goals, &preview)?;
            println!("   {solver:?} prepare {t1:?} begin {:?}", t0.elapsed()-t1);
            let mut clock = t0.elapsed();
            let mut line = String::new();
            for k in 0..60 {
                let s = r.step()?;
                clock += s.elapsed;
                if [1,2,3,5,8,10,12,15,20,25,30,40,60].contains(&(k+1)) {
                let mut p = preview.clone(); r.positions(&mut p)?;
                let true_e = arap.energy(&goals, &p)?;
                line += &format!("     {:3} {:.1}ms total {:.3} energy {:.4} (diff {:.1e}) err {:.4} {}\n", s.iteration, 1e3*s.elapsed.as_secs_f64(), clock.as_secs_f64()/total, s.energy/e, s.energy/true_e-1.0, err(&p)/err(&direct), s.settled);
                }
            }
            print!("{line}");
        }
    }
    Ok(())
}
