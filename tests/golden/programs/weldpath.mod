MODULE weldpath
  ! Written by weldpath. Call weldpath_run. Never run on a controller: try it in RobotStudio first.
  ! Edit: tool, work object (identity: the scan's base frame is wobj0), seam data, weld data.
  ! verdict: ready
  ! Not a safety function: the emergency stop must cut the power source by its
  ! own circuit.
  ! Check in the Arc configuration: weld error recovery and arc process restart.
  ! Not verified.
  ! Speeds of welddata are mm/s: check that the Arc units are SI (US units are
  ! inch a minute).
  ! The posture is the controller's choice: not checked.
  ! At the end the arm stays at the last point.
  PERS tooldata weldpath_tool:=[TRUE,[[0.0000,-50.0000,300.0000],[0.96891242,0.00000000,0.24740396,0.00000000]],[2.5,[0.0000,0.0000,0.0010],[1,0,0,0],0,0,0]];
  PERS wobjdata weldpath_wobj:=[FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  PERS seamdata weldpath_seam:=[0,0.5,[0,0,0,0,0,0,0,0,0],0,0,0,0,0,[0,0,0,0,0,0,0,0,0],0,0.3,[0,0,0,0,0,0,0,0,0],0,0,[0,0,0,0,0,0,0,0,0],0.5];
  CONST speeddata weldpath_v1:=[25,90,1000,1000];
  CONST speeddata weldpath_v2:=[150,90,1000,1000];
  PERS welddata weldpath_w1:=[8,0,[2,0,0,0,0,0,0,0,0],[0,0,0,0,0,0,0,0,0]];
  CONST zonedata weldpath_z:=[FALSE,0.282,0.282,0.282,0.1,0.282,0.1];
  LOCAL CONST robtarget p1:=[[-29.1449,229.4449,130.0000],[0.45576804,0.54062510,0.70455634,-0.06000300],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST robtarget p2:=[[-29.1449,229.4449,29.4449],[0.45576804,0.54062510,0.70455634,-0.06000300],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST robtarget p3:=[[-0.2774,200.5774,0.5774],[0.45576804,0.54062510,0.70455634,-0.06000300],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST robtarget p4:=[[29.7226,200.5774,0.5774],[0.45576804,0.54062510,0.70455634,-0.06000300],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST robtarget p5:=[[59.7226,200.5774,0.5774],[0.45576804,0.54062510,0.70455634,-0.06000300],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST robtarget p6:=[[59.7226,220.5774,0.5774],[0.36470520,0.11591690,0.88047624,-0.27984814],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST robtarget p7:=[[59.7226,240.5774,0.5774],[0.36470520,0.11591690,0.88047624,-0.27984814],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST robtarget p8:=[[30.8551,269.4449,29.4449],[0.36470520,0.11591690,0.88047624,-0.27984814],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST robtarget p9:=[[30.8551,269.4449,130.0000],[0.36470520,0.11591690,0.88047624,-0.27984814],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC weldpath_run()
    ConfJ\Off;
    ConfL\Off;
    SingArea\Off;
    MoveJ p1,weldpath_v2,fine,weldpath_tool\WObj:=weldpath_wobj;
    MoveL p2,weldpath_v2,fine,weldpath_tool\WObj:=weldpath_wobj;
    ArcLStart p3,weldpath_v1,weldpath_seam,weldpath_w1,fine,weldpath_tool\WObj:=weldpath_wobj;
    ArcL p4,weldpath_v1,weldpath_seam,weldpath_w1,z5,weldpath_tool\WObj:=weldpath_wobj;
    ArcL p5,weldpath_v1,weldpath_seam,weldpath_w1,weldpath_z,weldpath_tool\WObj:=weldpath_wobj;
    ArcL p6,weldpath_v1,weldpath_seam,weldpath_w1,z5,weldpath_tool\WObj:=weldpath_wobj;
    ArcLEnd p7,weldpath_v1,weldpath_seam,weldpath_w1,fine,weldpath_tool\WObj:=weldpath_wobj;
    MoveL p8,weldpath_v1,fine,weldpath_tool\WObj:=weldpath_wobj;
    MoveL p9,weldpath_v2,fine,weldpath_tool\WObj:=weldpath_wobj;
    ConfL\On;
    ConfJ\On;
  ENDPROC
ENDMODULE
