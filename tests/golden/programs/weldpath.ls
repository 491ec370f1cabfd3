/PROG  WELDPATH
/ATTR
OWNER		= MNEDITOR;
COMMENT		= "weldpath";
PROTECT		= READ_WRITE;
TCD:  STACK_SIZE	= 0,
      TASK_PRIORITY	= 50,
      TIME_SLICE	= 0,
      BUSY_LAMP_OFF	= 0,
      ABORT_REQUEST	= 0,
      PAUSE_REQUEST	= 0;
DEFAULT_GROUP	= 1,*,*,*,*;
CONTROL_CODE	= 00000000 00000000;
/APPL
  ARC Welding Equipment : 1,*,*,*,*;
/MN
   1:  !weldpath, never run on a robot ;
   2:  !Edit Arc Start[2] and CONFIG ;
   3:  !verdict: ready ;
   4:  !Not a safety function: the ;
   5:  !emergency stop must cut the ;
   6:  !power source by its own circuit. ;
   7:  !Check on the controller: Arc ;
   8:  !enable, weld restart (Resume). ;
   9:  !Not verified. ;
  10:  !The posture is the controller's ;
  11:  !choice: not checked. ;
  12:  !At the end the arm stays at the ;
  13:  !last point. ;
  14:  !Set UTOOL 3, mm and degrees ;
  15:  !X 0.0 W 0.00 ;
  16:  !Y -50.0 P 28.65 ;
  17:  !Z 300.0 R 0.00 ;
  18:  UFRAME_NUM=0 ;
  19:  UTOOL_NUM=3 ;
  20:J P[1] 10% FINE ;
  21:L P[2] 150mm/sec FINE ;
  22:L P[3] 25mm/sec FINE ;
  23:  Arc Start[2] ;
  24:L P[4] 8mm/sec CNT100 ;
  25:L P[5] 8mm/sec CNT35 ;
  26:L P[6] 8mm/sec CNT100 ;
  27:L P[7] 8mm/sec FINE ;
  28:  Arc End[2] ;
  29:L P[8] 25mm/sec FINE ;
  30:L P[9] 150mm/sec FINE ;
/POS
P[1]{
   GP1:
	UF : 0, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   -29.145  mm,	Y =   229.445  mm,	Z =   130.000  mm,
	W =  144.7356 deg,	P =   45.0000 deg,	R =   90.0000 deg
};
P[2]{
   GP1:
	UF : 0, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   -29.145  mm,	Y =   229.445  mm,	Z =    29.445  mm,
	W =  144.7356 deg,	P =   45.0000 deg,	R =   90.0000 deg
};
P[3]{
   GP1:
	UF : 0, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =    -0.277  mm,	Y =   200.577  mm,	Z =     0.577  mm,
	W =  144.7356 deg,	P =   45.0000 deg,	R =   90.0000 deg
};
P[4]{
   GP1:
	UF : 0, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =    29.723  mm,	Y =   200.577  mm,	Z =     0.577  mm,
	W =  144.7356 deg,	P =   45.0000 deg,	R =   90.0000 deg
};
P[5]{
   GP1:
	UF : 0, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =    59.723  mm,	Y =   200.577  mm,	Z =     0.577  mm,
	W =  144.7356 deg,	P =   45.0000 deg,	R =   90.0000 deg
};
P[6]{
   GP1:
	UF : 0, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =    59.723  mm,	Y =   220.577  mm,	Z =     0.577  mm,
	W = -144.7356 deg,	P =   45.0000 deg,	R =  180.0000 deg
};
P[7]{
   GP1:
	UF : 0, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =    59.723  mm,	Y =   240.577  mm,	Z =     0.577  mm,
	W = -144.7356 deg,	P =   45.0000 deg,	R =  180.0000 deg
};
P[8]{
   GP1:
	UF : 0, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =    30.855  mm,	Y =   269.445  mm,	Z =    29.445  mm,
	W = -144.7356 deg,	P =   45.0000 deg,	R =  180.0000 deg
};
P[9]{
   GP1:
	UF : 0, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =    30.855  mm,	Y =   269.445  mm,	Z =   130.000  mm,
	W = -144.7356 deg,	P =   45.0000 deg,	R =  180.0000 deg
};
/END
