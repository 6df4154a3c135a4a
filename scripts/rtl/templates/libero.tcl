# Libero project of ${name} for ${family} ${die}. Run it with `libero SCRIPT:${name}.tcl`.
set here [file normalize [file dirname [info script]]]
new_project -location [file join $$here project] -name {${name}} -project_description {} \
  -hdl {VERILOG} -family {${family}} -die {${die}} -package {${package}} -speed {${speed}} \
  -die_voltage {${voltage}} -part_range {${range}}
create_links -hdl_source [file normalize [file join $$here {${source}}]]
build_design_hierarchy
set_root -module {${name}::work}
save_project
puts "The project is ready: synthesise and lay out from the design flow window."
