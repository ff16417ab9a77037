O0008 (EVERY FUNCTION ONCE)
G21 G17 G90 G54
(trace:1 log_nc_machine_data its_items=model,serial_number)
(trace:1 get_operator_data)
(trace:1 log_operator_data its_function_id=P1 its_state=ON)
(trace:1 log_nc_events its_function_id=E1 its_state=ON)
(trace:1 start_tool_logging its_function_id=T1)
(trace:1 log_coolant_type)
(trace:1 log_coolant_data product="semi-synthetic %288 %%29" its_kind=emulsion concentration=8%)
(trace:+ ph=9.1 batch=K17)
(trace:1 set_edit_access_level its_level=3)
(trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN)
(trace:+ its_condition="ws_time > 1 s" its_actions="read_sensor_value its_sensor=position)
(trace:+ its_axes=X,Y,Z","read_sensor_value its_sensor=drive_load its_axes=X,Y,Z","set_alarm)
(trace:+ its_alarm_id=1 its_text=over_time","display_message its_text=""look at the tool""")
T1 M6
S3000 M3
G0 G43 H1 X0 Y0 Z10.
M8
(trace:1 get_time its_label="first cut")
(trace:1 log_tool_data)
(trace:1 start_sensor_recording its_function_id=R1 its_sensors=LOAD its_axes=X,Y,Z its_sampling=4)
(trace:1 read_sensor_value its_sensor=S1.LOAD)
(trace:1 get_cutting_speed_points number_of_points=10)
(trace:1 get_spindle_speed_points number_of_points=10)
(trace:1 get_feedrate_points number_of_points=10)
(trace:1 get_axis_speed_points number_of_points=10)
(trace:1 get_axis_acceleration_points number_of_points=10)
(trace:1 get_bearing_acceleration_points number_of_points=10)
(trace:1 get_spindle_acceleration_points number_of_points=10)
(trace:1 get_axial_cutting_depth_points number_of_points=10)
(trace:1 get_radial_cutting_depth_points number_of_points=10)
(trace:1 get_coolant_pressure_points number_of_points=10)
(trace:1 get_coolant_level_points number_of_points=10)
(trace:1 get_coolant_temperature_points number_of_points=10)
(trace:1 get_coolant_flow_points number_of_points=10)
(trace:1 get_interpolated_position_points number_of_points=10)
(trace:1 get_encoder_position_points number_of_points=10)
(trace:1 get_axis_displacement_points number_of_points=10)
(trace:1 get_motor_current_points number_of_points=10)
(trace:1 get_motor_power_points number_of_points=10)
(trace:1 get_drive_load_points number_of_points=10)
(trace:1 get_machine_force_points number_of_points=10)
(trace:1 get_motor_torque_points number_of_points=10)
(trace:1 get_tool_tip_temperature_points number_of_points=10)
(trace:1 get_tool_tip_vibration_points number_of_points=10)
(trace:1 get_acoustic_emission_points number_of_points=10)
(trace:1 get_tool_wear_points number_of_points=10)
G1 Z-2. F300.
X40. F600.
(trace:1 get_cutting_speed)
(trace:1 get_spindle_speed)
(trace:1 get_feedrate)
(trace:1 get_axis_speed)
(trace:1 get_axis_acceleration)
(trace:1 get_bearing_acceleration)
(trace:1 get_spindle_acceleration)
(trace:1 get_axial_cutting_depth)
(trace:1 get_radial_cutting_depth)
(trace:1 get_coolant_pressure)
(trace:1 get_coolant_level)
(trace:1 get_coolant_temperature)
(trace:1 get_coolant_flow)
(trace:1 get_interpolated_position)
(trace:1 get_encoder_position)
(trace:1 get_axis_displacement)
(trace:1 get_motor_current)
(trace:1 get_motor_power)
(trace:1 get_drive_load)
(trace:1 get_machine_force)
(trace:1 get_motor_torque)
(trace:1 get_tool_tip_temperature)
(trace:1 get_tool_tip_vibration)
(trace:1 get_acoustic_emission)
(trace:1 get_tool_wear)
(trace:1 log_event its_kind=corner its_text="first corner")
Y30.
X0
Y0
(trace:1 stop_sensor_recording its_function_id=R1)
(trace:1 set_alarm its_alarm_id=2 its_text="between the tools")
(trace:1 clear_alarm its_alarm_id=2)
G0 Z10.
M9
T2 M6
S4000 M3
G0 G43 H2 X10. Y10. Z10.
G1 Z-1. F300.
X30. F600.
G0 Z10.
T3 M6
S4000 M3
G0 G43 H3 X10. Y20. Z10.
G1 Z-1. F300.
X30. F600.
G0 Z10.
(trace:1 get_execution_time)
(trace:1 stop_synchronized_action its_id=1)
(trace:1 stop_tool_logging its_function_id=T1)
(trace:1 log_nc_events its_function_id=E1 its_state=OFF)
(trace:1 log_operator_data its_function_id=P1 its_state=OFF)
M5
M30
